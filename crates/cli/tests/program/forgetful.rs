//! `sch108bex master run` against a slave that loses its parameters before the configuration comes, as one
//! does whose watchdog expires in between.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;

use crate::driver::{Ended, end_of, program};

/// What the slave at address 5 answers master 2; `set_prm` counts the requests of that name. It keeps the
/// parameters of the second only.
fn answer(request: &[u8], set_prm: &mut u32) -> &'static [u8] {
    // In each comment the sum: DA, SA, FC and the data.
    const ALIVE: &[u8] = &[0x10, 0x02, 0x05, 0x00, 0x07, 0x16]; // 2 + 5
    const NO_SERVICE: &[u8] = &[0x10, 0x02, 0x05, 0x03, 0x0A, 0x16]; // 2 + 5 + 3
    // Wait_Prm, no fault: 82 + 85 + 08 + 3E + 3C + 02 + 05 + 00 + FF + 47 + 11 = 2E7
    const WAIT_PRM: &[u8] = &[
        0x68, 0x0B, 0x0B, 0x68, 0x82, 0x85, 0x08, 0x3E, 0x3C, 0x02, 0x05, 0x00, 0xFF, 0x47, 0x11, 0xE7, 0x16,
    ];
    // Data exchange with master 2: 82 + 85 + 08 + 3E + 3C + 00 + 04 + 00 + 02 + 47 + 11 = 1E7
    const EXCHANGING: &[u8] = &[
        0x68, 0x0B, 0x0B, 0x68, 0x82, 0x85, 0x08, 0x3E, 0x3C, 0x00, 0x04, 0x00, 0x02, 0x47, 0x11, 0xE7, 0x16,
    ];
    // 02 + 05 + 08 + 12 + 34 + 56 + 78 = 123
    const INPUTS: &[u8] = &[0x68, 0x07, 0x07, 0x68, 0x02, 0x05, 0x08, 0x12, 0x34, 0x56, 0x78, 0x23, 0x16];
    match *request {
        [0x10, 0x05, _, 0x49, ..] => ALIVE,
        [0x10, 0x05, ..] if *set_prm > 1 => INPUTS,
        [0x68, _, _, 0x68, 0x85, _, _, 0x3C, ..] if *set_prm > 1 => EXCHANGING,
        [0x68, _, _, 0x68, 0x85, _, _, 0x3C, ..] => WAIT_PRM,
        [0x68, _, _, 0x68, 0x85, _, _, 0x3D, ..] => {
            *set_prm += 1;
            &[0xE5]
        }
        [0x68, _, _, 0x68, 0x85, _, _, 0x3E, ..] if *set_prm > 1 => &[0xE5],
        [0x68, _, _, 0x68, 0x85, _, _, 0x3E, ..] => NO_SERVICE,
        _ => &[],
    }
}

/// Answers until the master goes.
fn serve(mut line: TcpStream) -> u32 {
    line.set_nodelay(true).expect("a socket");
    let (mut octets, mut set_prm) = (Vec::new(), 0);
    let mut buffer = [0; 512];
    while let Ok(count @ 1..) = line.read(&mut buffer) {
        octets.extend_from_slice(&buffer[..count]);
        loop {
            let length = match *octets {
                [0x10, ..] => 6,
                [0x68, length, ..] => usize::from(length) + 6,
                [0xDC, ..] => 3,
                _ => break,
            };
            if octets.len() < length {
                break;
            }
            let request: Vec<u8> = octets.drain(..length).collect();
            if line.write_all(answer(&request, &mut set_prm)).is_err() {
                return set_prm;
            }
        }
    }
    set_prm
}

#[test]
fn a_slave_that_has_lost_its_parameters_gets_them_again() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = format!("tcp:{}", listener.local_addr().expect("an address"));
    let slave = thread::spawn(move || serve(listener.accept().expect("the master").0));
    let mut master = program();
    master.args(["master", "--port", &port, "--reply-within", "300", "--address", "5", "run"]);
    master.args([
        "--prm",
        "00 00",
        "--cfg",
        "D1",
        "--ident",
        "0x4711",
        "--seconds",
        "0.5",
        "--watchdog",
        "0",
    ]);
    let Ended { status, output, errors } = end_of(&mut master);
    assert_eq!(status, Some(0), "{output}\n{errors}");
    assert!(output.contains("station 5 has no parameters any more, and gets them again"), "{output}");
    assert!(output.contains("inputs 12 34 56 78") && !errors.contains("refuses"), "{output}\n{errors}");
    // Two start-ups, and the unlock at the end.
    assert_eq!(slave.join().expect("no panic"), 3);
}
