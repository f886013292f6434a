//! The secret that opens the bench to other computers.

use std::fmt::Write;

/// Shorter ones could be guessed.
const LEAST: usize = 16;
/// Longer ones are none.
const MOST: usize = 128;

/// What a client has to show where the server is open to other computers.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

impl Token {
    /// One of the user's: 16 to 128 letters, digits, `-`, `_`, `.` or `~`, so that it can stand in an address.
    ///
    /// # Errors
    ///
    /// A sentence that says so.
    pub fn parse(text: &str) -> Result<Self, String> {
        let fits = |octet: u8| octet.is_ascii_alphanumeric() || b"-_.~".contains(&octet);
        if (LEAST..=MOST).contains(&text.len()) && text.bytes().all(fits) {
            return Ok(Self(text.to_owned()));
        }
        Err(format!("write {LEAST} to {MOST} letters, digits or any of - _ . ~"))
    }

    /// One that nobody can guess: 128 bits of chance.
    ///
    /// # Errors
    ///
    /// The system gives no chance.
    pub fn random() -> std::io::Result<Self> {
        let mut octets = [0_u8; 16];
        let mut filled = 0;
        while let Some(rest) = octets.get_mut(filled..).filter(|rest| !rest.is_empty()) {
            filled += rustix::rand::getrandom(rest, rustix::rand::GetRandomFlags::empty())?;
        }
        let mut text = String::with_capacity(32);
        for octet in octets {
            let _ = write!(text, "{octet:02x}");
        }
        Ok(Self(text))
    }

    /// As it is shown to the user.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether it is this one. The time that takes tells nothing of it.
    pub(crate) fn is(&self, text: &str) -> bool {
        let (own, other) = (self.0.as_bytes(), text.as_bytes());
        let differ = own.iter().zip(other).fold(0, |differ, (one, other)| differ | (one ^ other));
        own.len() == other.len() && std::hint::black_box(differ) == 0
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_itself_only() {
        let token = Token::parse("0123456789abcdef").expect("a token");
        assert!(token.is("0123456789abcdef"));
        for other in ["", "0123456789abcde", "0123456789abcdef0", "0123456789abcdeg", "1123456789abcdef"] {
            assert!(!token.is(other), "{other}");
        }
    }

    #[test]
    fn tokens_can_stand_in_an_address_and_are_not_shown() {
        for bad in ["short", "0123456789abcde", "0123456789abcdef&x=1", "0123456789abcdeé", &"a".repeat(129)]
        {
            assert!(Token::parse(bad).is_err(), "{bad}");
        }
        let random = Token::random().expect("chance");
        assert!(Token::parse(random.text()).is_ok());
        assert_ne!(random, Token::random().expect("chance"));
        assert!(!format!("{random:?}").contains(random.text()));
    }
}
