//! The process that serves a library: it loads it, and makes the calls that it is asked for, one after the other.
#![allow(unsafe_code)]

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use super::arrays::Memory;
use super::frames::{Request, Response, Ticked, receive, send};
use super::library::{Instance, Library, Model, MovedArrays, TickOutput};

/// Returns the number of calls of the allocator by this thread so far, where they are counted.
fn allocations() -> Option<u64> {
    #[cfg(feature = "realtime")]
    let count = crate::realtime::allocations::on_this_thread();
    #[cfg(not(feature = "realtime"))]
    let count = None;
    count
}

/// Serves a library over the socket at standard input until the other end closes it.
///
/// # Errors
/// If standard input is no such socket, or a request is not understood.
pub fn serve(path: &Path) -> io::Result<()> {
    let mut socket = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    leave_standard_input()?;
    // SAFETY: the arguments are constants of this call. A library that hangs must not outlive the program that asked.
    unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) };
    let library = match Library::load(path) {
        Ok(library) => Arc::new(library),
        Err(error) => return send(&mut socket, &Response::Loaded(Err(error))),
    };
    send(&mut socket, &Response::Loaded(Ok(())))?;
    let mut served: Option<Served> = None;
    loop {
        let request = match receive(&mut socket) {
            Ok(request) => request,
            // The program has no more use for the renderer, which is destroyed.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
            Err(error) => return Err(error),
        };
        let response = match (request, &mut served) {
            (Request::Create(body, setup), _) => {
                let created = Instance::create(library.clone(), &body, &setup, Memory::Guarded);
                Response::Created(created.map(|instance| served.insert(Served::new(instance)).instance.moves_nodes()))
            }
            (Request::Build(state), Some(Served { instance, .. })) => {
                Response::Built(instance.build(&state).map(Model::name).ok_or_else(|| instance.message()))
            }
            (Request::Swap(model), Some(Served { instance, .. })) => {
                Response::Swapped(Model::named(model).and_then(|model| instance.swap(model)).map(Model::name))
            }
            (Request::Dispose(model), Some(Served { instance, .. })) => {
                Model::named(model).into_iter().for_each(|model| instance.dispose(model));
                Response::Disposed
            }
            (Request::Tick(before, tip), Some(served)) => served.tick(before, tip),
            (_, None) => return Err(io::Error::new(io::ErrorKind::InvalidData, "there is no renderer yet")),
        };
        send(&mut socket, &response)?;
    }
}

/// Puts nothing in the place of standard input, which the library shares.
fn leave_standard_input() -> io::Result<()> {
    let nothing = File::open("/dev/null")?;
    // SAFETY: both are open descriptors.
    if unsafe { libc::dup2(nothing.as_raw_fd(), libc::STDIN_FILENO) } < 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(())
}

/// A renderer with the arrays that it is lent.
struct Served {
    instance: Instance,
    output: TickOutput,
    moved: MovedArrays,
}

impl Served {
    fn new(instance: Instance) -> Self {
        Self { output: TickOutput::new(Memory::Guarded), moved: instance.moved_arrays(), instance }
    }

    fn tick(&mut self, before: [f64; 3], tip: [f64; 3]) -> Response {
        let Self { instance, output, moved } = self;
        let (allocated, start) = (allocations(), Instant::now());
        let ticked = instance.tick(before, tip, output);
        let (nanoseconds, now) = (start.elapsed().as_nanos() as u64, allocations());
        let output = match ticked {
            Ok(output) => output,
            Err(number) => return Response::Faulted(number, instance.message()),
        };
        if let Err(many) = instance.moved(moved) {
            return Response::MovesTooMany(many.0);
        }
        let (nodes, x, v) = moved.get();
        let allocations = now.zip(allocated).map(|(now, before)| now - before);
        Response::Ticked(Ticked { output, nodes: nodes.into(), x: x.into(), v: v.into(), nanoseconds, allocations })
    }
}
