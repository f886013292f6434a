//! What a master hears when two stations send at once.

/// Lays `octets` over the first `length` octets of `line`, and says how many there are then.
///
/// The result never begins with a start delimiter, so that nobody takes it for a telegram.
pub(crate) fn collide(line: &mut [u8], length: usize, octets: &[u8]) -> usize {
    for (at, (place, &octet)) in line.iter_mut().zip(octets).enumerate() {
        *place = if at < length { *place & octet } else { octet };
    }
    if let (Some(first), true) = (line.first_mut(), length > 0) {
        *first ^= 0x5A;
    }
    length.max(octets.len().min(line.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_telegram_comes_out_of_two() {
        let mut line = [0; 255];
        for (one, other) in
            [(&[0xE5][..], &[0xE5][..]), (&[0x10, 2, 11, 0, 13, 0x16], &[0x68, 5, 5, 0x68, 2, 11, 8])]
        {
            let length = collide(&mut line, 0, one);
            assert_eq!(&line[..length], one);
            let length = collide(&mut line, length, other);
            assert_eq!(length, one.len().max(other.len()));
            assert!(![0x10, 0x68, 0xA2, 0xDC, 0xE5].contains(&line[0]));
        }
    }
}
