//! What interrupts of different priority share.

use core::cell::UnsafeCell;
use core::fmt;
use core::mem::MaybeUninit;
use core::sync::atomic::{Ordering, compiler_fence};

use cortex_m::interrupt;
use cortex_m::register::basepri;

/// Belongs to the interrupt of the highest priority; all others lock it with interrupts off, for
/// a few instructions.
pub struct Topmost<T>(UnsafeCell<MaybeUninit<T>>);

/// Belongs to the interrupts of the latch's priority; the main loop locks it by raising its own.
pub struct Latched<T>(UnsafeCell<MaybeUninit<T>>);

/// The priority of the latch as the core has it: level 1 of 16, in the upper four bits.
pub const LATCH_PRIORITY: u8 = 1 << 4;

// SAFETY: one core; each access is either at the owner's priority, which nothing that has access
// can interrupt, or with the owner locked out.
unsafe impl<T> Sync for Topmost<T> {}
// SAFETY: as above.
unsafe impl<T> Sync for Latched<T> {}

impl<T> Topmost<T> {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Where what comes first is made; before any interrupt is on.
    ///
    /// # Safety
    ///
    /// No interrupt that touches it may be on yet.
    #[inline(always)]
    #[expect(clippy::mut_from_ref, reason = "that is what the cell is for")]
    pub unsafe fn begin(&self) -> &mut MaybeUninit<T> {
        // SAFETY: nobody else is there, by the caller.
        unsafe { &mut *self.0.get() }
    }

    /// For the interrupt that owns it.
    ///
    /// # Safety
    ///
    /// Only there, once at a time, and after [`begin`](Self::begin).
    #[inline(always)]
    #[expect(clippy::mut_from_ref, reason = "that is what the cell is for")]
    pub unsafe fn own(&self) -> &mut T {
        // SAFETY: nothing else runs meanwhile, by the caller.
        unsafe { (*self.0.get()).assume_init_mut() }
    }

    /// For everybody else, after [`begin`](Self::begin): the interrupts wait meanwhile.
    #[inline(always)]
    pub fn lock<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        interrupt::free(|_| {
            // SAFETY: no interrupt comes in between; locks are not nested, `work` gets no cell.
            work(unsafe { (*self.0.get()).assume_init_mut() })
        })
    }
}

impl<T> Latched<T> {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Where what comes first is made; before any interrupt is on.
    ///
    /// # Safety
    ///
    /// No interrupt that touches it may be on yet.
    #[inline(always)]
    #[expect(clippy::mut_from_ref, reason = "that is what the cell is for")]
    pub unsafe fn begin(&self) -> &mut MaybeUninit<T> {
        // SAFETY: nobody else is there, by the caller.
        unsafe { &mut *self.0.get() }
    }

    /// For the interrupts that own it.
    ///
    /// # Safety
    ///
    /// Only there, once at a time, and after [`begin`](Self::begin).
    #[inline(always)]
    #[expect(clippy::mut_from_ref, reason = "that is what the cell is for")]
    pub unsafe fn own(&self) -> &mut T {
        // SAFETY: nothing else that touches it runs meanwhile, by the caller.
        unsafe { (*self.0.get()).assume_init_mut() }
    }

    /// For the main loop, after [`begin`](Self::begin): the latch waits meanwhile, the bus does not.
    #[inline(always)]
    pub fn lock<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        // SAFETY: raises the priority from none; nothing relies on interrupts of the latch here.
        unsafe { basepri::write(LATCH_PRIORITY) };
        compiler_fence(Ordering::SeqCst);
        // SAFETY: its owners wait; locks are not nested, only the main loop takes them.
        let result = work(unsafe { (*self.0.get()).assume_init_mut() });
        compiler_fence(Ordering::SeqCst);
        // SAFETY: the main loop runs with no priority of its own.
        unsafe { basepri::write(0) };
        result
    }
}

impl<T> Default for Topmost<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T> fmt::Debug for Topmost<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Topmost")
    }
}

impl<T> Default for Latched<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T> fmt::Debug for Latched<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Latched")
    }
}
