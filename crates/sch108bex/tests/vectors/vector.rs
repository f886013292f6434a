//! One vector: its inputs as numbers and words, its expectations, and what was left unread.

use std::cell::RefCell;
use std::collections::BTreeSet;

use serde_json::Value;

/// A vector on its way through a handler.
pub(crate) struct Vector<'a> {
    input: &'a Value,
    expected: &'a Value,
    read: RefCell<BTreeSet<(&'static str, String)>>,
    wrong: RefCell<Vec<String>>,
}

impl<'a> Vector<'a> {
    pub(crate) fn new(vector: &'a Value) -> Self {
        Self {
            input: &vector["input"],
            expected: &vector["expected"],
            read: RefCell::default(),
            wrong: RefCell::default(),
        }
    }

    fn mark(&self, part: &'static str, key: &str) {
        self.read.borrow_mut().insert((part, key.to_owned()));
    }

    /// An input; `None` if it is not there or `null`.
    pub(crate) fn get(&self, key: &str) -> Option<&'a Value> {
        self.mark("input", key);
        self.input.get(key).filter(|value| !value.is_null())
    }

    pub(crate) fn int(&self, key: &str) -> Option<i64> {
        self.get(key).map(|value| value.as_i64().expect("a whole number"))
    }

    /// A whole number that must be there and fit.
    pub(crate) fn number<T: TryFrom<i64>>(&self, key: &str) -> T {
        let value = self.int(key).unwrap_or_else(|| panic!("input {key} is missing"));
        T::try_from(value).unwrap_or_else(|_| panic!("input {key} does not fit"))
    }

    pub(crate) fn ints(&self, key: &str) -> Vec<i64> {
        let list = self.get(key).and_then(Value::as_array);
        let list = list.unwrap_or_else(|| panic!("input {key} is missing"));
        list.iter().map(|value| value.as_i64().expect("a whole number")).collect()
    }

    /// True and false, also as 1 and 0; false if it is not there.
    pub(crate) fn flag(&self, key: &str) -> bool {
        self.get(key).is_some_and(|value| value.as_bool().unwrap_or(value == 1))
    }

    pub(crate) fn text(&self, key: &str) -> &'a str {
        self.get(key).and_then(Value::as_str).unwrap_or_default()
    }

    pub(crate) fn words(&self, key: &str) -> Vec<&'a str> {
        let list = self.get(key).and_then(Value::as_array);
        list.into_iter().flatten().filter_map(Value::as_str).collect()
    }

    /// Octets written as hex digits.
    pub(crate) fn octets(&self, key: &str) -> Vec<u8> {
        unhex(self.text(key))
    }

    /// The number in hex digits.
    pub(crate) fn hex(&self, key: &str) -> u32 {
        u32::from_str_radix(self.text(key), 16).expect("hex digits")
    }

    /// Whether the vector expects this at all.
    pub(crate) fn expects(&self, key: &str) -> bool {
        self.expected.get(key).is_some()
    }

    /// What the vector expects under `key` must be `actual`.
    pub(crate) fn check(&self, key: &str, actual: impl Into<Value>) {
        self.mark("expected", key);
        let actual = actual.into();
        let expected = &self.expected[key];
        if *expected != actual {
            let line = format!("{key}: expected {expected}, computed {actual}");
            self.wrong.borrow_mut().push(line);
        }
    }

    /// The same for octets.
    pub(crate) fn check_octets(&self, key: &str, actual: &[u8]) {
        self.check(key, hex(actual));
    }

    /// What the vector expects without being checked here: read for the set-up.
    pub(crate) fn fault(&self, text: &str) {
        self.wrong.borrow_mut().push(text.to_owned());
    }

    /// All that was wrong, unread inputs and expectations included.
    pub(crate) fn faults(&self) -> Vec<String> {
        let mut faults = self.wrong.borrow().clone();
        for (part, values) in [("input", self.input), ("expected", self.expected)] {
            for key in values.as_object().into_iter().flat_map(|object| object.keys()) {
                if !self.read.borrow().contains(&(part, key.clone())) {
                    faults.push(format!("{part} {key} was not read"));
                }
            }
        }
        if self.expected.as_object().is_none_or(serde_json::Map::is_empty) {
            faults.push("nothing is expected".to_owned());
        }
        faults
    }
}

pub(crate) fn hex(octets: &[u8]) -> String {
    octets.iter().map(|octet| format!("{octet:02X}")).collect::<Vec<_>>().join(" ")
}

pub(crate) fn unhex(text: &str) -> Vec<u8> {
    let octet = |digits| u8::from_str_radix(digits, 16).expect("hex digits");
    text.split_whitespace().map(octet).collect()
}
