//! The example slave through a master's start-up: a DP-V0 slave that is no encoder.

// The example's main is not called here.
#[allow(dead_code, unreachable_pub, clippy::pedantic)]
#[path = "../examples/remote_io.rs"]
mod example;

use example::{ask, remote_io};
use profibus_dp::time::Instant;

// Telegrams and sums by hand: ident 1234, station 11, master 2.
#[test]
fn a_station_with_inputs_and_outputs_comes_to_data_exchange() {
    let mut slave = remote_io();
    slave.application_mut().inputs = [0xCA, 0xFE];
    let mut now = Instant::ZERO;

    let diag = [0x68, 0x05, 0x05, 0x68, 0x8B, 0x82, 0x6D, 0x3C, 0x3E, 0xF4, 0x16];
    assert_eq!(
        ask(&mut slave, &mut now, &diag),
        [
            0x68, 0x0D, 0x0D, 0x68, 0x82, 0x8B, 0x08, 0x3E, 0x3C, 0x02, 0x05, 0x00, 0xFF, 0x12, 0x34, 0x02,
            0x00, 0xDD, 0x16
        ]
    );
    let prm = |filter: u8, fc: u8| {
        let body = [0x8B, 0x82, fc, 0x3D, 0x3E, 0x80, 0, 0, 0x0B, 0x12, 0x34, 0, 0, filter];
        let fcs = body.iter().fold(0u8, |sum, octet| sum.wrapping_add(*octet));
        [&[0x68, 0x0E, 0x0E, 0x68], &body[..], &[fcs, 0x16]].concat()
    };
    assert_eq!(ask(&mut slave, &mut now, &prm(0, 0x5D)), [0xE5]);
    assert!(slave.application().log.iter().any(|line| line.contains("octet 9 (filter)")));
    assert_eq!(slave.application().filter, 0);
    assert_eq!(ask(&mut slave, &mut now, &prm(5, 0x7D)), [0xE5]);
    assert_eq!(slave.application().filter, 5);
    let cfg = [0x68, 0x07, 0x07, 0x68, 0x8B, 0x82, 0x5D, 0x3E, 0x3E, 0x11, 0x20, 0x17, 0x16];
    assert_eq!(ask(&mut slave, &mut now, &cfg), [0xE5]);

    let exchange = [0x68, 0x04, 0x04, 0x68, 0x0B, 0x02, 0x7D, 0x55, 0xDF, 0x16];
    assert_eq!(
        ask(&mut slave, &mut now, &exchange),
        [0x68, 0x05, 0x05, 0x68, 0x02, 0x0B, 0x08, 0xCA, 0xFE, 0xDD, 0x16]
    );
    assert_eq!(slave.application().output, 0x55);

    // An overload is announced with high priority until the owner has fetched it.
    slave.application_mut().overload = true;
    slave.diagnosis_changed();
    let exchange = [0x68, 0x04, 0x04, 0x68, 0x0B, 0x02, 0x5D, 0x55, 0xBF, 0x16];
    assert_eq!(
        ask(&mut slave, &mut now, &exchange),
        [0x68, 0x05, 0x05, 0x68, 0x02, 0x0B, 0x0A, 0xCA, 0xFE, 0xDF, 0x16]
    );
}
