//! A server with a plant behind it, and a client that sends exactly the octets that a test wants to.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use bus::memory::{MemoryEnd, pair};
use master::{LightMaster, Wire};
use plant::control::Subscriptions;
use plant::{EncoderSetup, Plant, Rate, Reporter, SegmentSetup, Shaft, Store, World};
use sch108bex::Identity;
use sch108bex::configuration::Configurations;
use sch108bex::end_cap::{RotarySwitches, TerminationSwitches};
use sch108bex::specification::{PLACEHOLDER_IDENT, SerialNumber, Variant};
use serde_json::Value;
use web::{Kind, Server, Settings, Setup, Shown, Token};

/// Longer than anything takes on a busy computer.
pub(crate) const PATIENCE: Duration = Duration::from_secs(10);

/// A server in front of an encoder with address 5, whose shaft stands at 65536.
pub(crate) struct Site {
    server: Server,
    pub(crate) address: SocketAddr,
    plant: Option<Plant>,
    /// Somebody has asked for the end of the program.
    pub(crate) ends: mpsc::Receiver<()>,
    master: Option<MemoryEnd>,
}

pub(crate) const TOKEN: &str = "0123456789abcdef";

pub(crate) fn site() -> Site {
    site_at("127.0.0.1:0", None)
}

pub(crate) fn site_at(address: &str, token: Option<&str>) -> Site {
    let (end, master) = pair();
    let (reports, from) = mpsc::channel();
    let subscriptions = Subscriptions::new();
    let forward = subscriptions.clone();
    std::thread::spawn(move || from.iter().for_each(|report| forward.publish(&report)));
    let encoder = EncoderSetup {
        identity: Identity {
            variant: Variant::FULL,
            ident_number: PLACEHOLDER_IDENT,
            serial_number: SerialNumber::DEFAULT,
            switches: RotarySwitches(5),
        },
        configurations: Configurations::default(),
        rate: Rate::OfTheEnd,
        termination: TerminationSwitches { first: true, second: true },
        shaft: Shaft::still(65_536),
        world: World::default(),
        store: Store::forgetful(),
        reporter: Reporter::new("encoder", Some(reports.clone())),
    };
    let segment = SegmentSetup {
        name: "bus".to_owned(),
        end: Box::new(end),
        // A loaded computer is no fault of the plant's.
        settings: bus::Settings {
            reply_limit: profibus_dp::time::Duration::from_secs(60),
            ..bus::Settings::default()
        },
        encoders: vec![encoder],
    };
    let mut plant = Plant::new();
    plant.add(segment, reports).expect("a plant");
    let (to, ends) = mpsc::channel();
    let shown =
        Shown::Plant { kind: Kind::Run, title: "A test".to_owned(), handle: plant.handle(), subscriptions };
    let setup = Setup {
        shown,
        on_shutdown: Box::new(move || {
            let _ = to.send(());
        }),
    };
    let settings = Settings {
        address: address.parse().expect("an address"),
        token: token.map(|token| Token::parse(token).expect("a token")),
    };
    let server = Server::start(&settings, setup).expect("a server");
    Site { address: server.address(), server, plant: Some(plant), ends, master: Some(master) }
}

/// A server that shows the demonstration.
pub(crate) fn demonstration() -> Site {
    let (to, ends) = mpsc::channel();
    let setup = Setup {
        shown: Shown::Demonstration,
        on_shutdown: Box::new(move || {
            let _ = to.send(());
        }),
    };
    let settings = Settings { address: "127.0.0.1:0".parse().expect("an address"), token: None };
    let server = Server::start(&settings, setup).expect("a server");
    Site { address: server.address(), server, plant: None, ends, master: None }
}

impl Site {
    /// The plant that others run.
    pub(crate) fn plant(&self) -> &Plant {
        self.plant.as_ref().expect("a plant")
    }

    /// Ends the server; how long that takes.
    pub(crate) fn end(self) -> Duration {
        let begun = Instant::now();
        drop(self.server);
        begun.elapsed()
    }

    /// The first snapshot that fits.
    #[track_caller]
    pub(crate) fn snapshot_when(&self, what: &str, fits: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let snapshot = self.get("/api/snapshot").json();
            if fits(&snapshot) {
                return snapshot;
            }
            assert!(begun.elapsed() < PATIENCE, "waited in vain for {what}: {snapshot}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// A master at the encoder's bus.
    pub(crate) fn master(&mut self) -> LightMaster<Wire> {
        let end = self.master.take().expect("one master");
        let wire = Wire::new(Box::new(end)).with_slot_time(profibus_dp::time::Duration::from_secs(5));
        LightMaster::new(wire, master::Settings::default())
    }

    /// A request as a plain client sends it.
    pub(crate) fn request(&self, method: &str, path: &str) -> Asking {
        Asking {
            address: self.address,
            head: format!("{method} {path} HTTP/1.1\r\n"),
            host: Some(self.address.to_string()),
            body: Vec::new(),
        }
    }

    pub(crate) fn get(&self, path: &str) -> Answer {
        self.request("GET", path).send()
    }

    pub(crate) fn post(&self, path: &str, body: &str) -> Answer {
        self.request("POST", path).json(body).send()
    }

    /// Opens the stream, and has read what it begins with.
    pub(crate) fn stream(&self, path: &str) -> Stream {
        let mut stream = Stream::open(self.request("GET", path));
        stream.until("snapshot", |_| true);
        stream
    }
}

/// A request to be sent.
pub(crate) struct Asking {
    address: SocketAddr,
    head: String,
    host: Option<String>,
    body: Vec<u8>,
}

impl Asking {
    pub(crate) fn header(mut self, name: &str, value: &str) -> Self {
        for part in [name, ": ", value, "\r\n"] {
            self.head.push_str(part);
        }
        self
    }

    pub(crate) fn host(mut self, host: Option<&str>) -> Self {
        self.host = host.map(str::to_owned);
        self
    }

    pub(crate) fn json(self, body: &str) -> Self {
        let mut asking = self.header("Content-Type", "application/json");
        asking.body = body.as_bytes().to_vec();
        asking
    }

    pub(crate) fn body(mut self, body: &[u8]) -> Self {
        self.body = body.to_vec();
        self
    }

    /// Sends it over a connection of its own, which stays open.
    pub(crate) fn open(self) -> TcpStream {
        let mut socket = TcpStream::connect(self.address).expect("it listens");
        socket.set_read_timeout(Some(PATIENCE)).expect("a time");
        let host = self.host.map_or(String::new(), |host| format!("Host: {host}\r\n"));
        let length = match self.body.len() {
            0 => String::new(),
            length => format!("Content-Length: {length}\r\n"),
        };
        let head = format!("{}{host}{length}\r\n", self.head);
        socket.write_all(head.as_bytes()).expect("it reads");
        // Whoever refuses a body need not read it.
        let _ = socket.write_all(&self.body);
        socket
    }

    pub(crate) fn send(self) -> Answer {
        Answer::read(&mut self.header("Connection", "close").open())
    }
}

/// An answer.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) headers: Vec<(String, String)>,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn read(socket: &mut TcpStream) -> Self {
        let mut octets = Vec::new();
        let _ = socket.read_to_end(&mut octets);
        Self::parse(&octets)
    }

    fn parse(octets: &[u8]) -> Self {
        let end = octets.windows(4).position(|four| four == b"\r\n\r\n").expect("a head");
        let head = String::from_utf8_lossy(&octets[..end]).into_owned();
        let mut lines = head.lines();
        let status = lines.next().and_then(|line| line.split(' ').nth(1)?.parse().ok()).expect("a status");
        let headers = lines.filter_map(|line| line.split_once(": "));
        let headers = headers.map(|(name, value)| (name.to_lowercase(), value.to_owned())).collect();
        Self { status, headers, body: octets[end + 4..].to_vec() }
    }

    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(own, _)| own == name).map(|(_, value)| value.as_str())
    }

    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    /// It is a problem document with this status; its sentence.
    #[track_caller]
    pub(crate) fn problem(&self, status: u16) -> String {
        assert_eq!(self.status, status, "{}", self.text());
        assert_eq!(self.header("content-type"), Some("application/problem+json"));
        let document = self.json();
        assert_eq!(document["status"], status);
        assert_eq!(document["type"], "about:blank");
        document["detail"].as_str().expect("a sentence").to_owned()
    }
}

/// The stream as a client reads it.
pub(crate) struct Stream {
    socket: TcpStream,
    unread: Vec<u8>,
    /// Inside the chunks of the transfer.
    text: String,
    begun: bool,
}

impl Stream {
    pub(crate) fn open(asking: Asking) -> Self {
        Self { socket: asking.open(), unread: Vec::new(), text: String::new(), begun: false }
    }

    /// The next event: its name and its data; a comment has neither. `None` at the end.
    pub(crate) fn next(&mut self) -> Option<(String, Value)> {
        loop {
            if let Some(end) = self.text.find("\n\n") {
                let event: String = self.text.drain(..end + 2).collect();
                let field = |name: &str| event.lines().find_map(|line| line.strip_prefix(name)).unwrap_or("");
                let data = serde_json::from_str(field("data: ")).unwrap_or_default();
                return Some((field("event: ").to_owned(), data));
            }
            let mut buffer = [0; 16_384];
            match self.socket.read(&mut buffer) {
                Ok(0) => return None,
                Ok(count) => self.unread.extend_from_slice(&buffer[..count]),
                Err(error) => panic!("nothing more comes: {error}"),
            }
            self.unchunk();
        }
    }

    /// Text out of chunks: a length in hexadecimal digits, a line end, so many octets, a line end.
    fn unchunk(&mut self) {
        if !self.begun {
            let Some(end) = self.unread.windows(4).position(|four| four == b"\r\n\r\n") else {
                return;
            };
            self.unread.drain(..end + 4);
            self.begun = true;
        }
        while let Some(end) = self.unread.windows(2).position(|two| two == b"\r\n") {
            let digits = String::from_utf8_lossy(&self.unread[..end]).into_owned();
            let length = usize::from_str_radix(&digits, 16).expect("a length");
            if length == 0 || self.unread.len() < end + 2 + length + 2 {
                return;
            }
            let chunk: Vec<u8> = self.unread.drain(..end + 2 + length + 2).collect();
            self.text.push_str(std::str::from_utf8(&chunk[end + 2..end + 2 + length]).expect("text"));
        }
    }

    /// The first event of this name that fits.
    #[track_caller]
    pub(crate) fn until(&mut self, name: &str, fits: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            match self.next() {
                Some((own, data)) if own == name && fits(&data) => return data,
                Some(_) => {}
                None => panic!("the stream ended while {name} was awaited"),
            }
        }
        panic!("waited in vain for {name}")
    }
}
