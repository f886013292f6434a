//! Sync and Freeze: outputs kept aside, inputs held.

/// The two modes and what they hold, for up to `IN` input and `OUT` output octets.
#[derive(Debug, Clone)]
pub struct FreezeSync<const IN: usize, const OUT: usize> {
    /// Freeze mode: the sum of the inputs held.
    frozen: Option<u8>,
    /// Sync mode.
    sync: Sync,
    inputs: [u8; IN],
    outputs: [u8; OUT],
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sync {
    Off,
    /// On, and nothing has come since the last Sync.
    Empty,
    /// On, with outputs kept aside.
    Holding,
}

impl<const IN: usize, const OUT: usize> Default for FreezeSync<IN, OUT> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const IN: usize, const OUT: usize> FreezeSync<IN, OUT> {
    /// Both modes off, nothing held.
    pub const fn new() -> Self {
        Self { frozen: None, sync: Sync::Off, inputs: [0; IN], outputs: [0; OUT] }
    }

    /// Both modes off.
    pub fn leave(&mut self) {
        (self.frozen, self.sync) = (None, Sync::Off);
    }

    /// Freeze mode.
    #[doc(alias = "Freeze_Mode")]
    pub const fn is_frozen(&self) -> bool {
        self.frozen.is_some()
    }

    /// Sync mode.
    #[doc(alias = "Sync_Mode")]
    pub fn is_sync(&self) -> bool {
        self.sync != Sync::Off
    }

    /// Holds `count` inputs that `read` writes (it returns their sum).
    pub fn freeze(&mut self, count: u8, read: impl FnOnce(&mut [u8]) -> u8) {
        self.frozen = self.inputs.get_mut(..usize::from(count)).map(read);
    }

    /// Inputs follow again.
    pub fn unfreeze(&mut self) {
        self.frozen = None;
    }

    /// Writes the inputs held; their sum. Zeros where none are.
    #[cold]
    pub fn read_frozen(&self, to: &mut [u8]) -> u8 {
        for (to, from) in to.iter_mut().zip(self.inputs.iter()) {
            *to = *from;
        }
        self.frozen.unwrap_or(0)
    }

    /// Keeps outputs aside.
    #[cold]
    pub fn hold(&mut self, octets: &[u8]) {
        for (to, from) in self.outputs.iter_mut().zip(octets.iter()) {
            *to = *from;
        }
        self.sync = Sync::Holding;
    }

    /// Clear_Data: what is kept aside is dropped.
    pub fn drop_held(&mut self) {
        if self.sync == Sync::Holding {
            self.sync = Sync::Empty;
        }
    }

    /// A Sync (`on`) or Unsync: the outputs kept aside that are to be passed on, of `count`.
    pub fn sync(&mut self, on: bool, count: u8) -> Option<&[u8]> {
        let held = self.sync == Sync::Holding;
        self.sync = if on { Sync::Empty } else { Sync::Off };
        if held { self.outputs.get(..usize::from(count)) } else { None }
    }
}
