//! The server: a thread, a runtime on it, and the connections.

use std::future::{Future, poll_fn};
use std::io;
use std::net::{SocketAddr, TcpListener as Socket};
use std::pin::pin;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use axum::Router;
use axum::http::StatusCode;
use futures_util::future::{Either, select};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustix::net::sockopt::set_socket_send_buffer_size;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::timeout;

use crate::api;
use crate::connection::{Connection, WRITE_PATIENCE};
use crate::guard::Guard;
use crate::problem::{MEDIA_TYPE, Problem};
use crate::publisher::Publisher;
use crate::stage::{Setup, Stage};
use crate::token::Token;

/// More connections at once are not served.
pub const MOST_CONNECTIONS: usize = 64;
/// More of them do not get the stream.
pub const MOST_STREAMS: usize = 16;
/// A longer body is none.
pub const MOST_OCTETS: usize = 65_536;

/// A longer head of a request is none.
const MOST_HEAD: usize = 16 * 1024;
/// A client that has begun a request sends its head within this time, and an idle one has gone after it.
const HEAD_PATIENCE: Duration = Duration::from_secs(30);
/// So many octets of an answer wait in the system.
const SEND_BUFFER: usize = 128 * 1024;
/// What is still open at the end is closed after this.
const END_PATIENCE: Duration = Duration::from_millis(300);
/// Threads for what has to wait for a segment.
const BLOCKING_THREADS: usize = 4;

/// Where it listens, and for whom.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Where; port 0 is any that is free.
    pub address: SocketAddr,
    /// What everybody has to show; `None`: nothing, for loopback addresses only.
    pub token: Option<Token>,
}

/// Why it does not run.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// Others could reach it.
    #[error("{0} can be reached by other computers, and then a token is needed")]
    Open(SocketAddr),
    /// It cannot listen there.
    #[error("cannot listen at {0}: {1}; choose another port, or 0 for any that is free")]
    Listen(SocketAddr, io::Error),
    /// The demonstration cannot begin.
    #[error(transparent)]
    Demonstration(#[from] plant::scenario::RunError),
    /// The system has no thread or no runtime for it.
    #[error("cannot start the web server: {0}")]
    System(#[from] io::Error),
}

/// The server while it runs. Dropping it ends it within a second.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    end: watch::Sender<bool>,
    publisher: Option<Publisher>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves the plant of `setup`.
    ///
    /// # Errors
    ///
    /// The address cannot be used.
    pub fn start(settings: &Settings, setup: Setup) -> Result<Self, StartError> {
        let asked = settings.address;
        if settings.token.is_none() && !asked.ip().is_loopback() {
            return Err(StartError::Open(asked));
        }
        let socket = Socket::bind(asked).map_err(|error| StartError::Listen(asked, error))?;
        socket.set_nonblocking(true)?;
        let address = socket.local_addr()?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_io()
            .enable_time()
            .max_blocking_threads(BLOCKING_THREADS)
            .build()?;
        let (end, ending) = watch::channel(false);
        let stage = Arc::new(Stage::new(setup)?);
        let publisher = Publisher::start(Arc::clone(&stage))?;
        let app = api::App::new(stage, publisher.batches(), ending.clone());
        let guard = Arc::new(Guard::new(address, settings.token.clone()));
        let router = api::router(app, guard);
        let thread = std::thread::Builder::new().name("web".to_owned()).spawn(move || {
            runtime.block_on(serve(socket, router, ending));
            // Nothing that still waits for a segment holds up the end.
            runtime.shutdown_background();
        })?;
        Ok(Self { address, end, publisher: Some(publisher), thread: Some(thread) })
    }

    /// Where it listens, the port resolved.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.end.send(true);
        drop(self.publisher.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

async fn serve(socket: Socket, router: Router, ending: watch::Receiver<bool>) {
    let Ok(listener) = TcpListener::from_std(socket) else {
        return;
    };
    let places = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    let farewells = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    let mut connections = JoinSet::new();
    let mut end = ending.clone();
    loop {
        let came = {
            let (accept, ends) = (pin!(listener.accept()), pin!(end.changed()));
            match select(accept, ends).await {
                Either::Left((came, _)) => came,
                Either::Right(_) => break,
            }
        };
        let Ok((client, _)) = came else {
            // No room in the system: others have to go first.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        while connections.try_join_next().is_some() {}
        match Arc::clone(&places).try_acquire_owned() {
            Ok(place) => {
                let _ = client.set_nodelay(true);
                // Who does not read holds no more of the system than this.
                let _ = set_socket_send_buffer_size(&client, SEND_BUFFER);
                let connection = Connection::new(client, WRITE_PATIENCE, place);
                connections.spawn(converse(connection, router.clone(), ending.clone()));
            }
            // Whoever comes when even these places are taken is closed without a word.
            Err(_) => {
                if let Ok(place) = Arc::clone(&farewells).try_acquire_owned() {
                    connections.spawn(send_away(client, place));
                }
            }
        }
    }
    drop(listener);
    let all = async { while connections.join_next().await.is_some() {} };
    // Who does not read is not waited for.
    let _ = timeout(END_PATIENCE, all).await;
}

/// One connection to its end.
async fn converse(connection: Connection, router: Router, mut ending: watch::Receiver<bool>) {
    let conversation = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_PATIENCE)
        .max_buf_size(MOST_HEAD)
        .serve_connection(TokioIo::new(connection), TowerToHyperService::new(router));
    let mut conversation = pin!(conversation);
    let ended = {
        let ends = pin!(ending.wait_for(|ends| *ends));
        matches!(select(conversation.as_mut(), ends).await, Either::Left(_))
    };
    if !ended {
        conversation.as_mut().graceful_shutdown();
        let _ = poll_fn(|context| conversation.as_mut().poll(context)).await;
    }
}

/// Says why to somebody for whom there is no place.
async fn send_away(mut client: TcpStream, _place: OwnedSemaphorePermit) {
    let problem = Problem::new(
        StatusCode::SERVICE_UNAVAILABLE,
        format!("{MOST_CONNECTIONS} connections are open already; close one of them and try again"),
    );
    let body = problem.body();
    let head = format!(
        "HTTP/1.1 503 Service Unavailable\r\ncontent-type: {MEDIA_TYPE}\r\ncontent-length: {}\r\n\
         retry-after: 1\r\nx-content-type-options: nosniff\r\nconnection: close\r\n\r\n",
        body.len()
    );
    let told = async {
        client.write_all(head.as_bytes()).await?;
        client.write_all(&body).await?;
        client.shutdown().await?;
        // Octets that nobody has read would make the system reset the connection, and the answer with it.
        let mut rest = [0; 1024];
        while tokio::io::AsyncReadExt::read(&mut client, &mut rest).await? > 0 {}
        io::Result::Ok(())
    };
    let _ = timeout(Duration::from_secs(1), told).await;
}
