//! A library's renderer in a child process: whatever it does there ends that process at most.
//!
//! Requests and responses go over a socket. A blocking read ends when the process does, without polling, and a read
//! that takes too long finds a call that hangs; shared memory would save some microseconds a tick, and have neither. The
//! process times each call itself.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::frames::{Request, Response, receive, send};
use super::in_process::{NO_MODE, NOT_COPIED, OWN_LAW, moves_too_many, no_model, tick_failed};
use super::library::{BodyData, SetupData, StateData};
use super::{LibraryError, RendererLibrary};
use crate::Vec3;
use crate::contact::renderer::{
    Body, BodyState, MovedNodes, Rendered, Renderer, RendererFault, RendererModel, Setup, TickCost,
};

/// Name of the command under which the program serves a library.
pub const COMMAND: &str = "serve-renderer";

/// A library's renderer in a child process. A copy of it cannot go on.
#[derive(Debug)]
pub struct HostedRenderer {
    options: String,
    connection: Option<Shared>,
}

type Shared = Arc<Mutex<Connection>>;

impl HostedRenderer {
    /// Starts a process that loads the library.
    ///
    /// # Errors
    /// If the process cannot be started, ends, or cannot use the library.
    pub fn open(library: &RendererLibrary, host: &Path) -> Result<Self, LibraryError> {
        let no_host = |reason: String| LibraryError::NoHost { path: library.path().to_owned(), reason };
        let mut connection =
            Connection::open(library, host).map_err(|error| no_host(format!("{}: {error}", host.display())))?;
        match connection.receive("its initialisers") {
            Ok(Response::Loaded(loaded)) => loaded?,
            Ok(_) => return Err(no_host("it is another program".to_owned())),
            Err(reason) => return Err(no_host(reason)),
        }
        Ok(Self { options: library.options().to_owned(), connection: Some(Arc::new(Mutex::new(connection))) })
    }
}

impl Clone for HostedRenderer {
    fn clone(&self) -> Self {
        Self { options: self.options.clone(), connection: None }
    }
}

impl Renderer for HostedRenderer {
    fn create(&mut self, body: Body<'_>, setup: &Setup) -> Result<(), RendererFault> {
        let setup = SetupData::new(setup, &self.options).ok_or(OWN_LAW)?;
        let request = Request::Create(BodyData::from(body), setup);
        match call(self.connection.as_ref(), &request, "stickslip_renderer_create")? {
            Response::Created(Ok(moves_nodes)) => {
                let connection = self.connection.as_ref().ok_or(NOT_COPIED)?;
                connection.lock().unwrap_or_else(PoisonError::into_inner).moves_nodes = moves_nodes;
                Ok(())
            }
            Response::Created(Err(message)) => Err(RendererFault::with_text(message)),
            _ => Err(NOT_UNDERSTOOD),
        }
    }

    fn build(&mut self, _: Body<'_>, state: BodyState<'_>) -> Result<Box<dyn RendererModel>, RendererFault> {
        let request = Request::Build(StateData::from(state));
        match call(self.connection.as_ref(), &request, "stickslip_renderer_build")? {
            Response::Built(Ok(model)) => {
                let mut built = Box::<HostedModel>::default();
                (built.connection, built.model) = (self.connection.clone(), Some(model));
                Ok(built)
            }
            Response::Built(Err(message)) => Err(no_model(message)),
            _ => Err(NOT_UNDERSTOOD),
        }
    }
}

/// The process sent another response than the one to its request.
const NOT_UNDERSTOOD: RendererFault = RendererFault("the process that serves it sent an unexpected response");

fn call(connection: Option<&Shared>, request: &Request, function: &str) -> Result<Response, RendererFault> {
    let mut connection = connection.ok_or(NOT_COPIED)?.lock().unwrap_or_else(PoisonError::into_inner);
    connection.call(request, function).map_err(RendererFault::with_text)
}

/// A model of a library's renderer in a child process.
#[derive(Debug, Default)]
struct HostedModel {
    /// `None` in a copy.
    connection: Option<Shared>,
    /// Name of the model that is disposed of with this value, or that is in use.
    model: Option<u64>,
    /// Whether the renderer uses the model, and frees it itself.
    is_in_use: bool,
    /// Why the model cannot be used.
    fault: Option<RendererFault>,
    nodes: Vec<u32>,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    cost: Option<TickCost>,
}

impl Clone for HostedModel {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl HostedModel {
    fn moves_nodes(&self) -> bool {
        let connection = self.connection.as_ref();
        connection.is_some_and(|connection| connection.lock().unwrap_or_else(PoisonError::into_inner).moves_nodes)
    }
}

impl RendererModel for HostedModel {
    fn take_over(&mut self, old: Option<&mut dyn RendererModel>) {
        let Some(model) = self.model else { return };
        match call(self.connection.as_ref(), &Request::Swap(model), "stickslip_renderer_swap") {
            Ok(Response::Swapped(returned)) => {
                self.is_in_use = true;
                let old = old.and_then(|old| (old as &mut dyn std::any::Any).downcast_mut::<Self>());
                if let Some(old) = old {
                    (old.model, old.is_in_use) = (returned, false);
                }
            }
            Ok(_) => self.fault = Some(NOT_UNDERSTOOD),
            Err(fault) => self.fault = Some(fault),
        }
    }

    fn tick(&mut self, before: Vec3, tip: Vec3) -> Result<Rendered, RendererFault> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        let request = Request::Tick(before.into(), tip.into());
        match call(self.connection.as_ref(), &request, "stickslip_renderer_tick")? {
            Response::Ticked(ticked) => {
                self.nodes = ticked.nodes;
                self.x = ticked.x.into_iter().map(Vec3::from).collect();
                self.v = ticked.v.into_iter().map(Vec3::from).collect();
                self.cost = Some(TickCost { nanoseconds: ticked.nanoseconds, allocations: ticked.allocations });
                ticked.output.rendered().ok_or(NO_MODE)
            }
            Response::Faulted(number, message) => Err(tick_failed(number, message)),
            Response::MovesTooMany(count) => Err(moves_too_many(count)),
            _ => Err(NOT_UNDERSTOOD),
        }
    }

    fn moved(&self) -> Option<MovedNodes<'_>> {
        self.moves_nodes().then_some(MovedNodes { nodes: &self.nodes, x: &self.x, v: &self.v })
    }

    fn own_cost(&self) -> Option<TickCost> {
        self.cost
    }
}

impl Drop for HostedModel {
    fn drop(&mut self) {
        if let (Some(connection), Some(model), false) = (&self.connection, self.model, self.is_in_use) {
            // A process that has ended has freed everything.
            let _ = call(Some(connection), &Request::Dispose(model), "stickslip_renderer_dispose");
        }
    }
}

/// The process and the socket to it.
#[derive(Debug)]
struct Connection {
    process: Child,
    socket: UnixStream,
    timeout: Duration,
    moves_nodes: bool,
    /// Number of ticks asked for.
    ticks: u64,
    /// What became of the process, once it has ended.
    ended: Option<String>,
}

impl Connection {
    fn open(library: &RendererLibrary, host: &Path) -> io::Result<Self> {
        let (socket, theirs) = UnixStream::pair()?;
        socket.set_read_timeout(Some(library.timeout))?;
        socket.set_write_timeout(Some(library.timeout))?;
        let process = Command::new(host)
            .arg(COMMAND)
            .arg(library.path())
            .stdin(OwnedFd::from(theirs))
            // What the library prints does not mix with results.
            .stdout(Stdio::from(io::stderr().as_fd().try_clone_to_owned()?))
            .spawn()?;
        Ok(Self { process, socket, timeout: library.timeout, moves_nodes: false, ticks: 0, ended: None })
    }

    fn call(&mut self, request: &Request, function: &str) -> Result<Response, String> {
        if let Some(ended) = &self.ended {
            return Err(ended.clone());
        }
        let place = match request {
            Request::Tick(..) => {
                self.ticks += 1;
                format!("{function} (call {})", self.ticks)
            }
            _ => function.to_owned(),
        };
        // A process that has ended does not read; the reason shows when its response is read.
        let _ = send(&mut self.socket, request);
        self.receive(&place)
    }

    /// Reads a response; `place` is the call that is waited for.
    fn receive(&mut self, place: &str) -> Result<Response, String> {
        receive(&mut self.socket).map_err(|error| {
            let reason = match error.kind() {
                io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => {
                    format!("{place} did not return within {} s", self.timeout.as_secs_f64())
                }
                _ => match self.end() {
                    Ok(status) => format!("{place} {}", describe(status)),
                    Err(error) => format!("{place}: {error}"),
                },
            };
            let _ = self.end();
            self.ended.insert(reason).clone()
        })
    }

    /// Ends the process, if it has not ended yet.
    fn end(&mut self) -> io::Result<ExitStatus> {
        /// Time within which a process that has closed its socket has ended.
        const PATIENCE: Duration = Duration::from_millis(500);
        let step = Duration::from_millis(5);
        for _ in 0..PATIENCE.as_millis() / step.as_millis() {
            if let Some(status) = self.process.try_wait()? {
                return Ok(status);
            }
            std::thread::sleep(step);
        }
        self.process.kill()?;
        self.process.wait()
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        // The process destroys the renderer and ends when its socket closes.
        let _ = self.socket.shutdown(std::net::Shutdown::Both);
        let _ = self.end();
    }
}

/// Describes how a process has ended in the middle of a call.
fn describe(status: ExitStatus) -> String {
    let Some(signal) = status.signal() else {
        return match status.code() {
            Some(code) => format!("ended the process with exit code {code}"),
            None => "ended the process".to_owned(),
        };
    };
    let name = match signal {
        libc::SIGABRT => "SIGABRT: it aborted",
        libc::SIGBUS => "SIGBUS: it accessed memory that is not there",
        libc::SIGFPE => "SIGFPE: an arithmetic error",
        libc::SIGILL => "SIGILL: an illegal instruction",
        libc::SIGKILL => "SIGKILL",
        libc::SIGSEGV => "SIGSEGV: it accessed memory beyond its arrays, or that it may only read",
        libc::SIGTRAP => "SIGTRAP",
        _ => "a signal",
    };
    format!("crashed with signal {signal} ({name})")
}
