//! The same conversation, said otherwise: what is due does not change.

use super::script::{Action, Conversation, Piece, Step};

/// How a conversation is played.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Variant {
    AsWritten,
    /// Every SRD high as SRD low: section 7.0 of the reference wants the whole list so, too.
    SrdLow,
    /// Every octet as a read of its own, as an interrupt delivers it.
    OctetByOctet,
}

impl Variant {
    pub(crate) const ALL: [Self; 3] = [Self::AsWritten, Self::SrdLow, Self::OctetByOctet];

    /// What a message says about it.
    pub(crate) const fn note(self) -> &'static str {
        match self {
            Self::AsWritten => "",
            Self::SrdLow => "with SRD low for SRD high: ",
            Self::OctetByOctet => "octet by octet: ",
        }
    }

    /// The conversation in this form.
    pub(crate) fn of(self, conversation: &Conversation) -> Conversation {
        let mut conversation = conversation.clone();
        self.rewrite(&mut conversation.steps);
        conversation
    }

    fn rewrite(self, steps: &mut [Step]) {
        for step in steps {
            match &mut step.action {
                Action::Exchange { request: pieces, .. } | Action::Foreign(pieces) => match self {
                    Self::AsWritten => {}
                    Self::SrdLow => to_srd_low(pieces),
                    Self::OctetByOctet => {
                        *pieces = pieces.drain(..).flat_map(|piece| [piece, Piece::Read]).collect();
                    }
                },
                Action::Repeat { body, .. } => self.rewrite(body),
                _ => {}
            }
        }
    }
}

/// Every whole telegram in the line that is an SRD high becomes an SRD low: FC and check sum - 1.
fn to_srd_low(pieces: &mut [Piece]) {
    let mut octets: Vec<&mut u8> = pieces
        .iter_mut()
        .filter_map(|piece| match piece {
            Piece::Octet(octet) => Some(octet),
            _ => None,
        })
        .collect();
    let mut from = 0;
    while from < octets.len() {
        let values: Vec<u8> = octets[from..].iter().map(|octet| **octet).collect();
        let Some((length, fc)) = request(&values) else {
            from += 1;
            continue;
        };
        if values[fc] & 0x4F == 0x4D {
            for place in [from + fc, from + length - 2] {
                *octets[place] = octets[place].wrapping_sub(1);
            }
        }
        from += length;
    }
}

/// The length of the error-free telegram at the beginning, and where its FC is.
fn request(octets: &[u8]) -> Option<(usize, usize)> {
    let (length, head) = match *octets.first()? {
        0x10 => (6, 1),
        0xA2 => (14, 1),
        0x68 => (usize::from(*octets.get(1)?) + 6, 4),
        _ => return None,
    };
    let telegram = octets.get(..length)?;
    let body = telegram.get(head..length - 2)?;
    let sum = body.iter().fold(0_u8, |sum, &octet| sum.wrapping_add(octet));
    (body.len() >= 3 && telegram[length - 2] == sum && telegram[length - 1] == 0x16)
        .then_some((length, head + 2))
}
