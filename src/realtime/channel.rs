//! The channel between servo thread and global thread: models one way, the patch's path the other. Neither side ever
//! waits for the other: a model lies in one of three buffers, the path goes through a ring.

use std::collections::VecDeque;

use rtrb::{Consumer, Producer, RingBuffer};
use triple_buffer::{Input, Output, TripleBuffer};

use crate::Vec3;
use crate::contact::state::Contact;
use crate::multirate::failsafe::FaultCause;
use crate::multirate::messages::{CycleMessage, ModelMessage};
use crate::multirate::servo::Servo;
use crate::multirate::trajectory::{PathRecording, Trajectory};

/// Number of cycles of the patch's path that fit into the ring.
const CYCLES_IN_RING: usize = 4;
/// Largest number of nodes of a later patch, as a multiple of the first patch's.
const PATCH_GROWTH: usize = 4;

/// A message of the global thread: a model, or the cause why there is none.
#[derive(Debug, Default)]
struct Slot {
    /// Number of the pass that the model was built in.
    pass: u32,
    /// Boundary that the model was built from, as a tick.
    from: u64,
    content: Option<Result<ModelMessage, FaultCause>>,
}

/// A note in the ring, followed by m positions and m velocities.
#[derive(Debug, Clone, Copy)]
struct Note {
    pass: u32,
    /// The tick that begins or that has been completed.
    tick: u64,
    kind: Kind,
    /// Boundary that the model in use was built from; it identifies the patch's nodes.
    from: u64,
    m: u32,
    contact: Option<Contact>,
    tip: Vec3,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A segment of the path begins, with a cycle or a model.
    Begin,
    /// A tick has been completed.
    Tick,
}

/// The servo thread's end of the channel.
pub struct ServoEnd {
    notes: Producer<Note>,
    values: Producer<Vec3>,
    models: Output<Slot>,
    pass: u32,
    /// Boundary that the model in use was built from.
    from: u64,
    is_open: bool,
    /// Number of notes lost because the ring was full.
    lost: u64,
}

/// The global thread's end of the channel.
pub struct GlobalEnd {
    notes: Consumer<Note>,
    values: Consumer<Vec3>,
    models: Input<Slot>,
    ticks_per_cycle: u64,
    recording: PathRecording,
    pass: u32,
    /// Nodes of every model that may still be in use, with the boundary it was built from.
    nodes: VecDeque<(u64, Vec<u32>)>,
    trajectory: Trajectory,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
}

/// Builds both ends for cycles of this many ticks and a first model of these nodes. Without a recording, the servo
/// thread sends nothing.
///
/// ```
/// use stickslip::{multirate::timeline::DeadlineOutcome, pipeline::{Sides, Simulation}, realtime::channel::channel, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let recording = simulation.recording();
/// let Sides { mut servo, mut global } = simulation.into_sides();
/// let (mut servo_end, mut global_end) = channel(100, recording, &servo.local().model().patch.nodes);
///
/// // The servo thread sends the path of one cycle, tick by tick.
/// servo_end.begin_pass(0, &servo);
/// for _ in 0..100 {
///     servo.tick(DeadlineOutcome::OnTime)?;
///     servo_end.end_tick(&servo);
/// }
/// assert_eq!(global_end.pass_waiting(), Some(0));
/// let (boundary, cycle) = global_end.next_cycle().expect("a whole cycle has come up");
/// assert_eq!((boundary, cycle.tip, servo_end.lost()), (100, servo.tip(), 0));
///
/// // The global thread sends the model that is built from it.
/// global_end.send(boundary, global.next_model([cycle], &mut |_| ()));
/// assert_eq!(servo_end.take_model(&mut servo), Ok(Some(100)));
/// servo_end.begin_segment(&servo);
/// assert_eq!(servo.local().model_age(), 0);
/// assert_eq!(servo_end.take_model(&mut servo), Ok(None)); // each model is taken once
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn channel(ticks_per_cycle: u64, recording: Option<PathRecording>, first_nodes: &[u32]) -> (ServoEnd, GlobalEnd) {
    // Every tick may also begin a segment.
    let records = 2 * CYCLES_IN_RING * ticks_per_cycle as usize;
    let (notes_up, notes) = RingBuffer::new(records);
    let (values_up, values) =
        RingBuffer::new(CYCLES_IN_RING * ticks_per_cycle as usize * 2 * PATCH_GROWTH * first_nodes.len());
    let (models, models_down) = TripleBuffer::default().split();
    let servo = ServoEnd {
        notes: notes_up,
        values: values_up,
        models: models_down,
        pass: 0,
        from: 0,
        is_open: recording.is_some(),
        lost: 0,
    };
    let recording = recording.unwrap_or(PathRecording::LastTick);
    let mut global = GlobalEnd {
        notes,
        values,
        models,
        ticks_per_cycle,
        recording,
        pass: 0,
        nodes: VecDeque::new(),
        trajectory: Trajectory::new(recording),
        x: Vec::new(),
        v: Vec::new(),
    };
    global.begin_pass(0, first_nodes);
    (servo, global)
}

impl ServoEnd {
    /// Begins a pass; messages of the last pass are ignored from here on.
    pub fn begin_pass(&mut self, pass: u32, servo: &Servo) {
        (self.pass, self.from) = (pass, 0);
        self.note(Kind::Begin, servo, 0);
    }

    /// Puts a model that has arrived to use, if there is one; the old one goes back to the global thread. Returns the
    /// boundary that the model was built from. Allocates nothing, frees nothing.
    ///
    /// # Errors
    /// If the global side has a fault; returned with the boundary at which it occurred.
    pub fn take_model(&mut self, servo: &mut Servo) -> Result<Option<u64>, (u64, FaultCause)> {
        if !self.models.update() {
            return Ok(None);
        }
        let slot = self.models.output_buffer_mut();
        if slot.pass != self.pass {
            return Ok(None);
        }
        match slot.content.take() {
            None => Ok(None),
            Some(Err(cause)) => Err((slot.from, cause)),
            Some(Ok(message)) => {
                slot.content = Some(Ok(servo.hand_over(message, slot.from)));
                self.from = slot.from;
                Ok(Some(slot.from))
            }
        }
    }

    /// Sends the begin of a segment with the next tick.
    pub fn begin_segment(&mut self, servo: &Servo) {
        self.note(Kind::Begin, servo, servo.next_tick());
    }

    /// Sends the end of a tick.
    pub fn end_tick(&mut self, servo: &Servo) {
        self.note(Kind::Tick, servo, servo.next_tick() - 1);
    }

    /// Returns the number of notes lost because the global side was cycles too late and the ring was full. The path
    /// that it received is then incomplete.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    fn note(&mut self, kind: Kind, servo: &Servo, tick: u64) {
        if !self.is_open {
            return;
        }
        let local = servo.local();
        let (m, state) = (local.model().patch.len(), local.state());
        let note = Note {
            pass: self.pass,
            tick,
            kind,
            from: self.from,
            m: m as u32,
            contact: local.contact(),
            tip: servo.tip(),
        };
        // Values first: a reader of the note finds them complete.
        if self.values.slots() < 2 * m || self.notes.is_full() {
            self.lost += 1;
            return;
        }
        let sent = self.values.push_entire_slice(&state.x[..m]).is_ok()
            && self.values.push_entire_slice(&state.v[..m]).is_ok()
            && self.notes.push(note).is_ok();
        self.lost += u64::from(!sent);
    }
}

impl GlobalEnd {
    /// Begins a pass with its first model.
    pub fn begin_pass(&mut self, pass: u32, nodes: &[u32]) {
        self.pass = pass;
        self.nodes.clear();
        self.nodes.push_back((0, nodes.to_vec()));
        self.trajectory = Trajectory::new(self.recording);
    }

    /// Returns the pass of the oldest note that waits.
    pub fn pass_waiting(&self) -> Option<u32> {
        self.notes.peek().ok().map(|note| note.pass)
    }

    /// Reads what has arrived of this pass, to the end of a cycle at most. Returns the boundary there, and the cycle
    /// before it.
    pub fn next_cycle(&mut self) -> Option<(u64, CycleMessage)> {
        while self.pass_waiting() == Some(self.pass) {
            let note = self.notes.pop().ok()?;
            self.take_values(note.m as usize);
            let tick_in_cycle = note.tick % self.ticks_per_cycle;
            match note.kind {
                Kind::Begin => {
                    let nodes = self.nodes.iter().find(|(from, _)| *from == note.from).map(|(_, nodes)| nodes);
                    let ticks = (self.ticks_per_cycle - tick_in_cycle) as usize;
                    let nodes = nodes.map_or(&[][..], Vec::as_slice);
                    self.trajectory.begin_at(nodes, &self.x, &self.v, tick_in_cycle as usize, ticks);
                }
                Kind::Tick => {
                    self.trajectory.record_at(&self.x, &self.v);
                    if tick_in_cycle + 1 == self.ticks_per_cycle {
                        let trajectory = std::mem::replace(&mut self.trajectory, Trajectory::new(self.recording));
                        let message = CycleMessage { trajectory, contact: note.contact, tip: note.tip };
                        return Some((note.tick + 1, message));
                    }
                }
            }
        }
        None
    }

    /// Sends a model, or the cause why there is none.
    pub fn send(&mut self, from: u64, content: Result<ModelMessage, FaultCause>) {
        if let Ok(message) = &content {
            self.nodes.push_back((from, message.model.patch.nodes.clone()));
            // One model may be in use, and one in each buffer.
            while self.nodes.len() > 4 {
                self.nodes.pop_front();
            }
        }
        // The buffer holds an old model that came back: it is freed here, not on the servo thread.
        *self.models.input_buffer_mut() = Slot { pass: self.pass, from, content: Some(content) };
        self.models.publish();
    }

    fn take_values(&mut self, m: usize) {
        for values in [&mut self.x, &mut self.v] {
            values.resize(m, Vec3::zeros());
            // Values are complete before their note.
            let complete = self.values.pop_entire_slice(values).is_ok();
            debug_assert!(complete, "a note without its values");
        }
    }
}
