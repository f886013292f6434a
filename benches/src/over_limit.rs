//! How far a Data_Exchange is from the least that any slave has to do with the same octets.

use std::hint::black_box;
use std::time::Instant;

use crate::device::Driven;
use crate::telegrams::{Functionality, exchange};

const BATCHES: usize = 31;
const ROUNDS: usize = 4000;
/// 4 outputs there, 4 inputs back.
const LENGTH: usize = 13;

/// The exchange's time over the bare loop's: both alternated, the shortest batch of each.
pub(crate) fn ratio() -> Result<f64, String> {
    let mut driven = Driven::in_data_exchange(Functionality::Class2)?;
    let requests = exchange();
    let (mut exchanged, mut bare) = (f64::MAX, f64::MAX);
    let (answer, mut sent) = ([0x55; LENGTH], [0; LENGTH]);
    for _ in 0..BATCHES {
        exchanged = exchanged.min(seconds(|round| {
            black_box(driven.exchange(black_box(requests[round % 2].as_slice())));
        }));
        bare = bare.min(seconds(|round| {
            let request = black_box(requests[round % 2].as_slice());
            black_box(zip_sum_copy(request, black_box(&answer), black_box(&mut sent)));
        }));
    }
    eprintln!("exchange {:.1} ns, bare loop {:.1} ns", nanos(exchanged), nanos(bare));
    Ok(exchanged / bare)
}

fn seconds(mut round: impl FnMut(usize)) -> f64 {
    let started = Instant::now();
    (0..ROUNDS).for_each(&mut round);
    started.elapsed().as_secs_f64()
}

fn nanos(batch: f64) -> f64 {
    batch * 1e9 / f64::from(u32::try_from(ROUNDS).unwrap_or(u32::MAX))
}

/// Sums the octets that come and those that go, and copies the latter, one by one.
#[inline(never)]
fn zip_sum_copy(request: &[u8], answer: &[u8], sent: &mut [u8]) -> u8 {
    let mut sum = 0_u8;
    for ((asked, told), to) in request.iter().zip(answer).zip(sent) {
        let (asked, told) = (black_box(*asked), black_box(*told));
        sum = sum.wrapping_add(asked).wrapping_add(told);
        *to = told;
    }
    sum
}
