//! Messages between this program and the process that serves a library, as length-prefixed frames.

use std::io::{self, Read, Write};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::LibraryError;
use super::library::{BodyData, OutputData, SetupData, StateData};

/// Largest frame that is accepted, bytes: a body of ten million springs has less.
const LARGEST_FRAME: u32 = 1 << 30;

/// What the program asks of the process.
#[derive(Debug, Serialize, Deserialize)]
pub enum Request {
    /// Creates the renderer.
    Create(BodyData, SetupData),
    /// Builds a model.
    Build(StateData),
    /// Puts a model to use.
    Swap(u64),
    /// Renders a tick: the tip before and after it, m.
    Tick([f64; 3], [f64; 3]),
    /// Frees a model.
    Dispose(u64),
}

/// The process's response.
#[derive(Debug, Serialize, Deserialize)]
pub enum Response {
    /// First of all: the library is loaded, or why not.
    Loaded(Result<(), LibraryError>),
    /// The renderer is created; whether it reports the nodes that it moves. Or why it refuses.
    Created(Result<bool, String>),
    /// Name of the model. Or the library's message.
    Built(Result<u64, Option<String>>),
    /// Name of the model that was in use.
    Swapped(Option<u64>),
    /// Result of a tick.
    Ticked(Ticked),
    /// The tick failed, with the fault's number and the library's message.
    Faulted(i32, Option<String>),
    /// The renderer moves this many nodes, more than the body has.
    MovesTooMany(u64),
    /// The model is freed.
    Disposed,
}

/// Result of a tick, and its cost.
#[derive(Debug, Serialize, Deserialize)]
pub struct Ticked {
    pub output: OutputData,
    pub nodes: Vec<u32>,
    pub x: Vec<[f64; 3]>,
    pub v: Vec<[f64; 3]>,
    /// Time of the call, ns.
    pub nanoseconds: u64,
    /// Calls of the allocator in it, freeing included, where they are counted.
    pub allocations: Option<u64>,
}

/// Writes a message.
///
/// # Errors
/// If the other process has ended, or the message is too large.
pub fn send(to: &mut impl Write, message: &impl Serialize) -> io::Result<()> {
    let bytes = postcard::to_stdvec(message).map_err(io::Error::other)?;
    let length = u32::try_from(bytes.len()).ok().filter(|&length| length <= LARGEST_FRAME);
    let length = length.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a frame is too large"))?;
    to.write_all(&length.to_le_bytes())?;
    to.write_all(&bytes)
}

/// Reads a message.
///
/// # Errors
/// If the other process has ended, does not answer in time, or has sent something else.
pub fn receive<M: DeserializeOwned>(from: &mut impl Read) -> io::Result<M> {
    let mut length = [0; 4];
    from.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length);
    if length > LARGEST_FRAME {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "a frame is too large"));
    }
    let mut bytes = vec![0; length as usize];
    from.read_exact(&mut bytes)?;
    postcard::from_bytes(&bytes).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
}
