//! Identifier octets of a slave's own configuration, as Get_Cfg tells them.

/// Whether they are whole, and none is a special identifier of length 15: that one is only for Chk_Cfg,
/// where it says that the maker's octets are not to be compared.
pub(crate) fn whole(octets: &[u8]) -> Result<(), String> {
    if octets.is_empty() {
        return Err("a configuration without identifiers came".to_owned());
    }
    let mut rest = octets;
    while let [identifier, behind @ ..] = rest {
        // Bits 5 and 4: input or output; neither is the special format.
        if identifier & 0x30 != 0 {
            rest = behind;
            continue;
        }
        let makers = usize::from(identifier & 0x0F);
        if makers == 15 {
            return Err(format!(
                "special identifier {identifier:02X} has length 15, which is only allowed in Chk_Cfg"
            ));
        }
        let lengths = usize::from(identifier >> 6 & 1) + usize::from(identifier >> 7);
        rest = behind.get(lengths + makers..).ok_or_else(|| {
            format!(
                "{} octets have to follow special identifier {identifier:02X}, but {} do",
                lengths + makers,
                behind.len()
            )
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    // DP slave reference, section 6.4.
    #[test]
    fn general_and_special_identifiers_are_whole() {
        for octets in [
            &[0xD1][..],
            &[0xF1, 0xD1, 0xD1],
            &[0x00],
            &[0x40, 0xC3],
            &[0x81, 0x03, 0xAA],
            &[0xC3, 0xCF, 0xC7, 1, 2, 3],
        ] {
            assert_eq!(whole(octets), Ok(()), "{octets:02X?}");
        }
    }

    #[test]
    fn length_15_and_missing_octets_are_told() {
        for octets in [&[0x0F][..], &[0xD1, 0x4F, 0x00], &[0xCF, 0xC0, 0xC0]] {
            assert!(
                whole(octets).expect_err("length 15").contains("only allowed in Chk_Cfg"),
                "{octets:02X?}"
            );
        }
        for octets in [&[0x40][..], &[0xC0, 0x01], &[0xC3, 0xCF, 0xC7, 1, 2], &[0x01]] {
            assert!(whole(octets).expect_err("missing").contains("have to follow"), "{octets:02X?}");
        }
        assert!(whole(&[]).is_err());
    }
}
