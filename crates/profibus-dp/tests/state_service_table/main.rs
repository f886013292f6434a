//! Every state x every service, as the tables of the DP-V0 slave reference have them (sections
//! 3.2, 3.3, 4.2): the answer, the state after it as Slave_Diag shows it, and the outputs.
//!
//! The device is a small one: 2 octets in (AA BB), 1 octet out, configuration 11 20, ident 1234,
//! address 11 (0B). Master 2 is the owner where there is one, master 3 is another, and master 9
//! only looks. In data exchange the outputs are 5A before the request.

mod device;
mod other_devices;
mod requests;
mod telegrams;

use device::{Line, TestDevice};
use requests::requests;
use telegrams::{ONLOOKER, OTHER, OWNER, PRM, SELF, Sent, hex, sd2, telegram};

/// A cell is the answer and, behind `->`, the state after it with its fault or mode bits; without
/// `->` the state stays. `outputs XX`: what is in force afterwards, else 5A in data exchange and
/// 00 elsewhere.
const TABLE: &str = "
request                    | WAIT_PRM            | WAIT_CFG owner              | WAIT_CFG other | DATA_EXCH owner             | DATA_EXCH other | at 126

FDL status                 | OK                  | OK                          | OK             | OK                          | OK              | OK
Ident                      | NR                  | NR                          | NR             | NR                          | NR              | NR
LSAP status                | RS                  | RS                          | RS             | RS                          | RS              | RS

Slave_Diag                 | diagnosis           | diagnosis                   | diagnosis      | diagnosis                   | diagnosis       | diagnosis
Slave_Diag with data       | RR                  | RR                          | RR             | RR                          | RR              | RR
Get_Cfg                    | 11 20               | 11 20                       | 11 20          | 11 20                       | 11 20           | 11 20
Get_Cfg with data          | RR                  | RR                          | RR             | RR                          | RR              | RR

Set_Prm good               | E5 -> WAIT_CFG      | E5                          | RS             | E5                          | RS              | RS
Set_Prm wrong ident        | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm 0 octets           | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm 6 octets           | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm reserved bit       | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm watchdog factor 0  | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm DPV1_Enable        | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm bad for the device | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm outgrown           | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM              | RS              | RS
Set_Prm with watchdog      | E5 -> WAIT_CFG wd   | E5 -> WAIT_CFG wd           | RS             | E5 -> DATA_EXCH wd          | RS              | RS
Set_Prm unlock             | E5                  | E5 -> WAIT_PRM              | RS             | E5 -> WAIT_PRM              | RS              | RS
Set_Prm lock and unlock    | E5                  | E5 -> WAIT_PRM              | RS             | E5 -> WAIT_PRM              | RS              | RS
Set_Prm unlock wrong ident | E5 -> WAIT_PRM prm  | E5 -> WAIT_PRM prm          | RS             | E5 -> WAIT_PRM prm          | RS              | RS
Set_Prm only min T_SDR     | E5                  | E5                          | RS             | E5                          | RS              | RS

Chk_Cfg good               | RS                  | E5 -> DATA_EXCH outputs 00  | RS             | E5                          | RS              | RS
Chk_Cfg bad                | RS                  | E5 -> WAIT_PRM cfg          | RS             | E5 -> WAIT_PRM cfg          | RS              | RS
Chk_Cfg longer             | RS                  | E5 -> WAIT_PRM cfg          | RS             | E5 -> WAIT_PRM cfg          | RS              | RS
Chk_Cfg empty              | RS                  | E5 -> WAIT_PRM cfg          | RS             | E5 -> WAIT_PRM cfg          | RS              | RS

Set_Slave_Add good         | E5 -> address 12    | RS                          | RS             | RS                          | RS              | E5 -> address 12
Set_Slave_Add wrong ident  | E5                  | RS                          | RS             | RS                          | RS              | E5
Set_Slave_Add to 0         | E5                  | RS                          | RS             | RS                          | RS              | E5
Set_Slave_Add to 126       | E5                  | RS                          | RS             | RS                          | RS              | E5
Set_Slave_Add 3 octets     | E5                  | RS                          | RS             | RS                          | RS              | E5

RD_Inp                     | RS                  | RS                          | RS             | AA BB                       | AA BB           | RS
RD_Inp with data           | RS                  | RS                          | RS             | RR                          | RR              | RS
RD_Outp                    | RS                  | RS                          | RS             | 5A                          | 5A              | RS
RD_Outp with data          | RS                  | RS                          | RS             | RR                          | RR              | RS

Data_Exchange good         | RS                  | RS                          | RS             | AA BB outputs C3            | RS              | RS
Data_Exchange empty        | RS                  | RS                          | RS             | AA BB outputs 00            | RS              | RS
Data_Exchange 2 octets     | RS                  | RS                          | RS             | RS -> WAIT_PRM              | RS              | RS
Data_Exchange 8 octets SD3 | RS                  | RS                          | RS             | RS -> WAIT_PRM              | RS              | RS

Clear_Data to all          | silence             | silence                     | silence        | silence outputs 00          | silence         | silence
Clear_Data to the slave    | silence             | silence                     | silence        | silence outputs 00          | silence         | silence
Clear_Data other group     | silence             | silence                     | silence        | silence                     | silence         | silence
Sync                       | silence             | silence                     | silence        | silence -> DATA_EXCH sync   | silence         | silence
Freeze                     | silence             | silence                     | silence        | silence -> DATA_EXCH freeze | silence         | silence
Operate                    | silence             | silence                     | silence        | silence                     | silence         | silence
Global_Control reserved    | silence             | silence                     | silence        | silence                     | silence         | silence
Global_Control 1 octet     | silence             | silence                     | silence        | silence                     | silence         | silence
Global_Control 3 octets    | silence             | silence                     | silence        | silence                     | silence         | silence

Global_Control as SRD      | RS                  | RS                          | RS             | RS                          | RS              | RS
other SAPs, SRD            | RS                  | RS                          | RS             | RS                          | RS              | RS
all SAPs, SDA              | RS                  | RS                          | RS             | RS                          | RS              | RS
no SAP, SDA                | RS                  | RS                          | RS             | RS                          | RS              | RS
all SAPs but 58, SDN       | silence             | silence                     | silence        | silence                     | silence         | silence
no SAP, SDN                | silence             | silence                     | silence        | silence                     | silence         | silence
reserved functions         | silence             | silence                     | silence        | silence                     | silence         | silence
responses                  | silence             | silence                     | silence        | silence                     | silence         | silence
";

/// A column: where the slave stands, and who asks.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Column {
    state: &'static str,
    address: u8,
    requester: u8,
}

fn column(title: &str) -> Column {
    let (state, address, requester) = match title {
        "WAIT_PRM" => ("WAIT_PRM", SELF, OWNER),
        "WAIT_CFG owner" => ("WAIT_CFG", SELF, OWNER),
        "WAIT_CFG other" => ("WAIT_CFG", SELF, OTHER),
        "DATA_EXCH owner" => ("DATA_EXCH", SELF, OWNER),
        "DATA_EXCH other" => ("DATA_EXCH", SELF, OTHER),
        "at 126" => ("WAIT_PRM", 126, OWNER),
        _ => panic!("`{title}` is no column"),
    };
    Column { state, address, requester }
}

impl Column {
    /// A fresh slave, brought there.
    fn line(self) -> Line {
        let mut line = Line::new(self.address, TestDevice::of_the_table());
        match self.state {
            "WAIT_CFG" => line.parameterize(&PRM),
            "DATA_EXCH" => {
                line.start_up(&PRM);
                let outputs = telegram(SELF, OWNER, 0x7D, None, &[0x5A]);
                line.ask_ok(&outputs, &sd2(&[OWNER, SELF, 0x08, 0xAA, 0xBB]));
            }
            _ => {}
        }
        line
    }

    fn diagnosis(self) -> [u8; 6] {
        diagnosis(self.state, "")
    }
}

/// Reference 4.1 and 4.6: octets 1 to 4 of a state, with a fault or a mode.
fn diagnosis(state: &str, bits: &str) -> [u8; 6] {
    let [first, second, owner] = match state {
        "WAIT_PRM" => [0x02, 0x05, 0xFF],
        "WAIT_CFG" => [0x02, 0x04, OWNER],
        "DATA_EXCH" => [0x00, 0x04, OWNER],
        _ => panic!("`{state}` is no state"),
    };
    let (faults, modes) = match bits {
        "" => (0, 0),
        "prm" => (0x40, 0),
        "cfg" => (0x04, 0),
        "wd" => (0, 0x08),
        "freeze" => (0, 0x10),
        "sync" => (0, 0x20),
        _ => panic!("`{bits}` is no fault and no mode"),
    };
    [first | faults, second | modes, 0x00, owner, 0x12, 0x34]
}

/// What a cell demands.
#[derive(Debug)]
struct Cell {
    answer: String,
    diagnosis: [u8; 6],
    address: u8,
    outputs: u8,
}

fn cell(text: &str, column: Column) -> Cell {
    let (text, outputs) = match text.split_once(" outputs ") {
        Some((text, outputs)) => (text, Some(outputs)),
        None => (text, None),
    };
    let (answer, then) = match text.split_once(" -> ") {
        Some((answer, then)) => (answer, Some(then)),
        None => (text, None),
    };
    let (mut after, mut address) = (column.diagnosis(), column.address);
    match then.map(|then| then.split_once(' ').unwrap_or((then, ""))) {
        Some(("address", new)) => address = new.parse().expect("an address"),
        Some((state, bits)) => after = diagnosis(state, bits),
        None => {}
    }
    let exchanging = after[0] & 0x02 == 0;
    let outputs = outputs.map_or(if exchanging { 0x5A } else { 0x00 }, |outputs| {
        u8::from_str_radix(outputs, 16).expect("two hex digits")
    });
    Cell { answer: answer.trim().to_owned(), diagnosis: after, address, outputs }
}

/// The octets of the answer that a cell names.
fn answer(name: &str, column: Column, sent: &Sent) -> Vec<u8> {
    let (slave, master) = (column.address, column.requester);
    let short = |fc| telegram(master, slave, fc, None, &[]);
    let data = |octets: &[u8]| match sent {
        Sent::Srd(Some(sap), _) => sd2(&[&[master | 0x80, slave | 0x80, 0x08, 0x3E, *sap], octets].concat()),
        _ => sd2(&[&[master, slave, 0x08], octets].concat()),
    };
    match name {
        "silence" => Vec::new(),
        "E5" => vec![0xE5],
        "OK" => short(0x00),
        "RR" => short(0x02),
        "RS" => short(0x03),
        "NR" => short(0x09),
        "diagnosis" => data(&column.diagnosis()),
        octets => {
            let octets: Vec<_> = octets
                .split(' ')
                .map(|octet| u8::from_str_radix(octet, 16).expect("an answer or hex digits"))
                .collect();
            data(&octets)
        }
    }
}

#[test]
fn every_service_in_every_state() {
    let mut rows = TABLE.lines().filter(|line| !line.is_empty());
    let split = |line: &'static str| line.split('|').map(str::trim).collect::<Vec<_>>();
    let titles = split(rows.next().expect("the titles"));
    let columns: Vec<_> = titles[1..].iter().map(|title| column(title)).collect();
    let (mut cases, mut wrong) = (0, Vec::new());
    for row in rows.map(split) {
        assert_eq!(row.len(), titles.len(), "{}", row[0]);
        for (&column, (text, title)) in columns.iter().zip(row[1..].iter().zip(&titles[1..])) {
            for sent in requests(row[0]) {
                for fc in sent.function_codes() {
                    cases += 1;
                    if let Err(message) = check(&sent, fc, column, &cell(text, column)) {
                        wrong.push(format!("{} x {title} ({text}): {message}", row[0]));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "of {cases} cases:\n{}", wrong.join("\n"));
    assert!(cases > 3000, "only {cases} cases");
}

/// One case, and its retry where it has a frame count bit.
fn check(sent: &Sent, fc: u8, column: Column, due: &Cell) -> Result<(), String> {
    let mut line = column.line();
    let request = sent.wire(column.address, column.requester, fc);
    let expected = answer(&due.answer, column, sent);
    same("answer", &line.ask(&request), &expected, &request)?;
    let retry = fc | 0x10;
    if matches!(fc, 0x6C | 0x6D) && due.address == column.address {
        let again = sent.wire(column.address, column.requester, retry);
        same("answer to the retry", &line.ask(&again), &expected, &again)?;
    }
    if due.address != column.address {
        same("answer at the old address", &line.ask(&request), &[], &request)?;
    }
    same("diagnosis", &line.diagnosis(due.address), &due.diagnosis, &request)?;
    let device = line.slave.application();
    same("outputs", &device.outputs, &[due.outputs], &request)?;
    if due.diagnosis[0] & 0x02 == 0 {
        let read = telegram(due.address, ONLOOKER, 0x4D, Some(0x39), &[]);
        let body = [ONLOOKER | 0x80, due.address | 0x80, 0x08, 0x3E, 0x39, due.outputs];
        same("RD_Outp", &line.ask(&read), &sd2(&body), &request)?;
    }
    Ok(())
}

fn same(what: &str, got: &[u8], due: &[u8], request: &[u8]) -> Result<(), String> {
    if got == due {
        return Ok(());
    }
    Err(format!("{what} is [{}], due [{}], after {}", hex(got), hex(due), hex(request)))
}

/// Reference 2.2, the guard: a retry repeats the function too. SRD low under the FCB of an SRD high is new, and
/// its own retry is not.
#[test]
fn a_retry_repeats_the_function() {
    let mut line = column("DATA_EXCH owner").line();
    let read = |fc| telegram(SELF, OWNER, fc, Some(0x38), &[]);
    let inputs = |octets: [u8; 2]| sd2(&[&[0x82, 0x8B, 0x08, 0x3E, 0x38], &octets[..]].concat());
    line.ask_ok(&read(0x5D), &inputs([0xAA, 0xBB]));
    line.slave.application_mut().inputs = vec![0xCC, 0xDD];
    line.ask_ok(&read(0x5D), &inputs([0xAA, 0xBB]));
    line.ask_ok(&read(0x5C), &inputs([0xCC, 0xDD]));
    line.slave.application_mut().inputs = vec![0xEE, 0xFF];
    line.ask_ok(&read(0x5C), &inputs([0xCC, 0xDD]));
    line.ask_ok(&read(0x5D), &inputs([0xEE, 0xFF]));
}
