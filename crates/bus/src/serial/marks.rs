//! How the system marks characters with errors among those without (`PARMRK`).
//!
//! | read | means |
//! |---|---|
//! | `FF FF` | the octet FF |
//! | `FF 00` and an octet | that octet had a parity or framing error; 00: perhaps a break |
//! | anything else | itself |

/// Where in a mark the next octet stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Marks {
    #[default]
    Outside,
    /// After FF.
    Begun,
    /// After FF 00.
    Error,
}

/// What was found first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    /// So many octets without errors, or none.
    Octets(usize),
    /// A character with an error.
    Error,
}

impl Marks {
    /// Looks at what was read up to the first character with an error, and puts the octets before it
    /// into `buffer`, as many as it holds. Says how many were looked at.
    #[inline]
    pub(super) fn look(&mut self, read: &[u8], buffer: &mut [u8]) -> (usize, Found) {
        let mut count = 0;
        for (at, &octet) in read.iter().enumerate() {
            let Some(place) = buffer.get_mut(count) else {
                return (at, Found::Octets(count));
            };
            (*self, count) = match (*self, octet) {
                (Self::Outside, 0xFF) => (Self::Begun, count),
                (Self::Begun, 0x00) => (Self::Error, count),
                // FF FF, or FF before something that it does not mark: as it stands.
                (Self::Outside | Self::Begun, octet) => {
                    *place = octet;
                    (Self::Outside, count + 1)
                }
                // What comes before the error is told first.
                (Self::Error, _) if count > 0 => return (at, Found::Octets(count)),
                (Self::Error, _) => {
                    *self = Self::Outside;
                    return (at + 1, Found::Error);
                }
            };
        }
        (read.len(), Found::Octets(count))
    }

    /// Forgets a mark that was begun.
    pub(super) fn forget(&mut self) {
        *self = Self::Outside;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All that is in `chunks`: octets, and `None` for each character with an error.
    fn read(chunks: &[&[u8]], room: usize) -> Vec<Option<u8>> {
        let mut marks = Marks::default();
        let mut buffer = vec![0; room];
        let mut all = Vec::new();
        for chunk in chunks {
            let mut rest = *chunk;
            while !rest.is_empty() {
                let (used, found) = marks.look(rest, &mut buffer);
                assert!(used > 0 || found != Found::Octets(0), "it goes on");
                rest = &rest[used..];
                match found {
                    Found::Octets(count) => all.extend(buffer[..count].iter().copied().map(Some)),
                    Found::Error => all.push(None),
                }
            }
        }
        all
    }

    #[test]
    fn octets_and_errors_come_in_their_order() {
        // 10, an error, FF, a break, FF 00 as two octets, 16.
        let line = [0x10, 0xFF, 0x00, 0x55, 0xFF, 0xFF, 0xFF, 0x00, 0x00, 0xFF, 0xFF, 0x00, 0x16];
        let due = [Some(0x10), None, Some(0xFF), None, Some(0xFF), Some(0x00), Some(0x16)];
        for cut in 0..=line.len() {
            for room in 1..5 {
                assert_eq!(read(&[&line[..cut], &line[cut..]], room), due, "cut at {cut}, room for {room}");
            }
        }
    }

    #[test]
    fn a_mark_that_was_begun_can_be_forgotten() {
        for begun in [&[0xFF][..], &[0xFF, 0x00]] {
            let mut marks = Marks::default();
            assert_eq!(marks.look(begun, &mut [0; 4]), (begun.len(), Found::Octets(0)));
            marks.forget();
            let mut buffer = [0; 4];
            assert_eq!(marks.look(&[0x00, 0x55], &mut buffer), (2, Found::Octets(2)));
            assert_eq!(buffer[..2], [0x00, 0x55]);
        }
    }

    #[test]
    fn one_octet_at_a_time_is_the_same() {
        let line = [0xFF, 0xFF, 0xFF, 0x00, 0xE5, 0xE5];
        let pieces: Vec<_> = line.chunks(1).collect();
        assert_eq!(read(&pieces, 1), [Some(0xFF), None, Some(0xE5)]);
    }
}
