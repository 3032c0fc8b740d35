//! The channel between servo thread and global side: models one way, the patch's path the other. Neither side ever
//! waits for the other: a model lies in one of three buffers, and the path goes through a ring. A separate thread empties
//! the ring ([`Intake`]), so that a global side that computes for many cycles loses nothing of the path.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use rtrb::{Consumer, Producer, RingBuffer};
use triple_buffer::{Input, Output, TripleBuffer};

use crate::Vec3;
use crate::contact::renderer::Rendered;
use crate::contact::state::Contact;
use crate::multirate::failsafe::FaultCause;
use crate::multirate::messages::{CycleMessage, ModelMessage};
use crate::multirate::servo::Servo;
use crate::multirate::trajectory::{PathRecording, Trajectory};

/// Time for which the path fits into the ring, s: far longer than a thread of high priority waits for a CPU.
const RING_S: f64 = 0.5;
/// Least and largest number of ticks that fit into the ring.
const RING_TICKS: [f64; 2] = [64.0, 4096.0];
/// Largest number of nodes of a later patch, as a multiple of the first patch's.
const PATCH_GROWTH: usize = 4;
/// Largest number of vectors in the ring for a custom renderer, which may move every node: 64 MiB.
const MOST_VALUES: usize = (64 << 20) / size_of::<Vec3>();

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
    /// Number of nodes that precede this note in a ring of their own: those of a custom renderer.
    nodes: Option<u32>,
    contact: Option<Contact>,
    tip: Vec3,
    /// Result of the last computed tick.
    rendered: Rendered,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A segment of the path begins, with a cycle or a model.
    Begin,
    /// A tick has been completed.
    Tick,
    /// A tick has been skipped.
    Skipped,
}

/// The servo thread's end of the channel.
pub struct ServoEnd {
    notes: Producer<Note>,
    values: Producer<Vec3>,
    /// The nodes of a custom renderer, which only its ticks tell.
    nodes: Producer<u32>,
    models: Output<Slot>,
    pass: u32,
    /// Boundary that the model in use was built from.
    from: u64,
    /// Whether a segment begins with the next tick of a custom renderer, which only then has moved nodes.
    is_segment_due: bool,
    is_open: bool,
    /// Number of notes lost because the ring was full.
    lost: u64,
}

/// Settings of a channel, by which it makes room for the path of the patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelSettings {
    /// Local tick h, s.
    pub tick_s: f64,
    /// Number of ticks in a global cycle.
    pub ticks_per_cycle: u64,
    /// Number of ticks in a pass.
    pub pass_ticks: u64,
    /// The part of the patch's path that is sent; without it, the servo thread sends nothing.
    pub recording: Option<PathRecording>,
    /// Number of the body's nodes that a custom renderer may move; 0 without one.
    pub rendered_nodes: usize,
}

impl ChannelSettings {
    /// Returns the number of ticks whose path fits into the ring.
    pub fn ring_ticks(&self) -> usize {
        let [least, largest] = RING_TICKS;
        (RING_S / self.tick_s).clamp(least, largest) as usize
    }
}

/// A cycle that has passed.
#[derive(Debug)]
pub struct PastCycle {
    /// Number of the pass.
    pub pass: u32,
    /// The tick at its end.
    pub boundary: u64,
    /// What the global side needs of the cycle.
    pub message: CycleMessage,
}

/// Nodes of every model that may still be in use, with the pass in which the model was built and the boundary from which it
/// was.
type NodesInUse = Arc<Mutex<VecDeque<(u32, u64, Vec<u32>)>>>;

/// The end of the channel that receives the path.
pub struct Intake {
    notes: Consumer<Note>,
    values: Consumer<Vec3>,
    moved_nodes: Consumer<u32>,
    settings: ChannelSettings,
    recording: PathRecording,
    pass: u32,
    first_nodes: Vec<u32>,
    nodes: NodesInUse,
    trajectory: Trajectory,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    moved: Vec<u32>,
}

/// The end of the channel that sends models.
pub struct ModelSender {
    models: Input<Slot>,
    nodes: NodesInUse,
}

/// Builds the ends of a channel for passes that all begin with a model of these nodes.
///
/// ```
/// use stickslip::multirate::timeline::DeadlineOutcome;
/// use stickslip::pipeline::{Sides, Simulation};
/// use stickslip::realtime::channel::{ChannelSettings, channel};
/// use stickslip::scene::Scene;
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let recording = simulation.recording();
/// let Sides { mut servo, mut global } = simulation.into_sides();
/// let settings = ChannelSettings { tick_s: 1e-3, ticks_per_cycle: 100, pass_ticks: 1200, recording, rendered_nodes: 0 };
/// assert_eq!(settings.ring_ticks(), 500);
/// let (mut servo_end, mut intake, mut sender) = channel(settings, &servo.local().model().patch.nodes);
///
/// // The servo thread sends the path of one cycle, tick by tick.
/// servo_end.begin_pass(0, &servo);
/// for _ in 0..100 {
///     servo.tick(DeadlineOutcome::OnTime)?;
///     servo_end.end_tick(&servo);
/// }
/// let cycle = intake.next_cycle().expect("a whole cycle has come up");
/// assert_eq!((cycle.pass, cycle.boundary, cycle.message.tip, servo_end.lost()), (0, 100, servo.tip(), 0));
///
/// // The global thread sends the model that is built from it.
/// sender.send(0, cycle.boundary, global.next_model([cycle.message], &mut |_| ()));
/// assert_eq!(servo_end.take_model(&mut servo), Ok(Some(100)));
/// servo_end.begin_segment(&servo);
/// assert_eq!(servo.local().model_age(), 0);
/// assert_eq!(servo_end.take_model(&mut servo), Ok(None)); // each model is taken once
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn channel(settings: ChannelSettings, first_nodes: &[u32]) -> (ServoEnd, Intake, ModelSender) {
    let ring_ticks = settings.ring_ticks();
    // Every tick may also begin a segment.
    let (notes_up, notes) = RingBuffer::new(2 * ring_ticks);
    let rendered = settings.rendered_nodes;
    // Of a renderer that moves all of a large body, two ticks at least.
    let of_renderer = (ring_ticks * 2 * rendered).min(MOST_VALUES.max(4 * rendered));
    let (values_up, values) = RingBuffer::new((ring_ticks * 2 * PATCH_GROWTH * first_nodes.len()).max(of_renderer));
    let (nodes_up, moved_nodes) = RingBuffer::new(4 * rendered);
    let (models, models_down) = TripleBuffer::default().split();
    let servo = ServoEnd {
        notes: notes_up,
        values: values_up,
        nodes: nodes_up,
        models: models_down,
        pass: 0,
        from: 0,
        is_segment_due: false,
        is_open: settings.recording.is_some(),
        lost: 0,
    };
    let recording = settings.recording.unwrap_or(PathRecording::LastTick);
    let nodes = NodesInUse::default();
    let mut intake = Intake {
        notes,
        values,
        moved_nodes,
        settings,
        recording,
        pass: 0,
        first_nodes: first_nodes.to_vec(),
        nodes: nodes.clone(),
        trajectory: Trajectory::new(recording),
        x: Vec::new(),
        v: Vec::new(),
        moved: Vec::new(),
    };
    intake.begin_pass(0);
    (servo, intake, ModelSender { models, nodes })
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

    /// Sends the end of a tick that was skipped.
    pub fn skip_tick(&mut self, servo: &Servo) {
        self.note(Kind::Skipped, servo, servo.next_tick() - 1);
    }

    /// Returns the number of notes lost because the ring was full: the thread that empties it did not run for half a
    /// second. The path that the global side received is then incomplete.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    fn note(&mut self, kind: Kind, servo: &Servo, tick: u64) {
        if !self.is_open {
            return;
        }
        let local = servo.local();
        let Some(moved) = local.moved() else {
            let (m, state) = (local.model().patch.len(), local.state());
            let values = state.x[..m].iter().chain(&state.v[..m]).copied();
            return self.send(self.note_of(kind, servo, tick, m), &[], values);
        };
        let m = moved.nodes.len();
        let values = || moved.x.iter().chain(moved.v).copied();
        match kind {
            Kind::Begin => self.is_segment_due = true,
            Kind::Tick if self.is_segment_due => {
                self.is_segment_due = false;
                let begin = Note { nodes: Some(m as u32), ..self.note_of(Kind::Begin, servo, tick, 0) };
                self.send(begin, moved.nodes, [].into_iter());
                self.send(self.note_of(kind, servo, tick, m), &[], values());
            }
            // There is no segment yet that it could belong to.
            Kind::Skipped if self.is_segment_due => self.send(self.note_of(kind, servo, tick, 0), &[], [].into_iter()),
            Kind::Tick | Kind::Skipped => self.send(self.note_of(kind, servo, tick, m), &[], values()),
        }
    }

    fn note_of(&self, kind: Kind, servo: &Servo, tick: u64, m: usize) -> Note {
        Note {
            pass: self.pass,
            tick,
            kind,
            from: self.from,
            m: m as u32,
            nodes: None,
            contact: servo.local().contact(),
            tip: servo.tip(),
            rendered: servo.report().rendered(),
        }
    }

    /// Sends a note with its m nodes, if it brings them, and its 2m values. Allocates nothing.
    fn send(&mut self, note: Note, nodes: &[u32], values: impl Iterator<Item = Vec3>) {
        let sent = (|| {
            // Nodes and values first: a reader of the note finds them complete.
            let (room, room_for_nodes) = (2 * note.m as usize, self.nodes.slots() >= nodes.len());
            if !room_for_nodes || self.notes.is_full() {
                return None;
            }
            self.values.write_chunk_uninit(room).ok()?.fill_from_iter(values);
            self.nodes.push_entire_slice(nodes).ok()?;
            self.notes.push(note).ok()
        })();
        self.lost += u64::from(sent.is_none());
    }
}

impl Intake {
    fn begin_pass(&mut self, pass: u32) {
        self.pass = pass;
        let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        nodes.retain(|(of, _, _)| *of >= pass);
        nodes.push_front((pass, 0, self.first_nodes.clone()));
        self.trajectory = Trajectory::new(self.recording);
    }

    /// Reads what has arrived, to the end of a cycle at most, and returns the cycle.
    pub fn next_cycle(&mut self) -> Option<PastCycle> {
        let ticks_per_cycle = self.settings.ticks_per_cycle;
        while let Ok(note) = self.notes.pop() {
            if note.pass != self.pass {
                self.begin_pass(note.pass);
            }
            self.take_values(note.m as usize);
            if let Some(count) = note.nodes {
                self.moved.resize(count as usize, 0);
                let complete = self.moved_nodes.pop_entire_slice(&mut self.moved).is_ok();
                debug_assert!(complete, "a note without its nodes");
            }
            let tick_in_cycle = note.tick % ticks_per_cycle;
            match note.kind {
                Kind::Begin => {
                    let ticks = (ticks_per_cycle - tick_in_cycle).min(self.settings.pass_ticks);
                    let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
                    // Models come into use in the order in which they were built.
                    while nodes.front().is_some_and(|(pass, from, _)| (*pass, *from) < (note.pass, note.from)) {
                        nodes.pop_front();
                    }
                    let (first, ticks) = (tick_in_cycle as usize, ticks as usize);
                    match note.nodes {
                        Some(_) => self.trajectory.begin_nodes(&self.moved, first, ticks),
                        None => {
                            let nodes = nodes.front().map_or(&[][..], |(_, _, nodes)| nodes);
                            self.trajectory.begin_at(nodes, &self.x, &self.v, first, ticks);
                        }
                    }
                }
                Kind::Tick | Kind::Skipped => {
                    let Rendered { force, contact, .. } = note.rendered;
                    match self.recording {
                        PathRecording::Forces => {
                            let point = contact.filter(|_| note.kind == Kind::Tick).map(|(point, _)| point);
                            self.trajectory.record_push(force, point);
                        }
                        PathRecording::EveryTick | PathRecording::LastTick => {
                            self.trajectory.record_at(&self.x, &self.v);
                        }
                    }
                    if tick_in_cycle + 1 == ticks_per_cycle {
                        let trajectory = std::mem::replace(&mut self.trajectory, Trajectory::new(self.recording));
                        let (contact, tip, rendered) = (note.contact, note.tip, note.rendered);
                        let message = CycleMessage { trajectory, contact, tip, rendered };
                        return Some(PastCycle { pass: note.pass, boundary: note.tick + 1, message });
                    }
                }
            }
        }
        None
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

impl ModelSender {
    /// Sends the model that was built from a boundary of a pass, or the cause why there is none.
    pub fn send(&mut self, pass: u32, from: u64, content: Result<ModelMessage, FaultCause>) {
        if let Ok(message) = &content {
            let nodes = message.model.patch.nodes.clone();
            self.nodes.lock().unwrap_or_else(PoisonError::into_inner).push_back((pass, from, nodes));
        }
        // The buffer holds an old model that came back: it is freed here, not on the servo thread.
        *self.models.input_buffer_mut() = Slot { pass, from, content: Some(content) };
        self.models.publish();
    }
}
