//! Semi-implicit Euler (11) over columns, by one thread or by two that share the network's halves.
//!
//! Both ways do the same operations in the same order for every node: springs of its half, then springs of the seam.
//! Each of two threads moves the nodes of its half. The positions and velocities that the seam's springs need from the
//! other half are sent as one message a step, while each thread sweeps its own springs. Both threads then compute the
//! forces in the seam, rather than wait for each other a second time.

use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use pulp::Arch;

use super::constraint::{Constraint, Steps};
use crate::Vec3;
use crate::model::columns::Columns;
use crate::model::network::Network;
use crate::model::springs::{Halves, Part};
use crate::model::state::State;

/// Scratch of one thread for its nodes.
#[derive(Debug, Clone)]
pub(super) struct Worker {
    columns: Columns,
    /// State passed to constraints; only the nodes that they act on are set.
    imposed: State,
    accelerations: Vec<Vec3>,
}

impl Worker {
    pub fn new(network: &Network) -> Self {
        let zeros = vec![Vec3::zeros(); network.node_count()];
        Self {
            columns: Columns::new(zeros.len()),
            imposed: State { x: zeros.clone(), v: zeros.clone() },
            accelerations: zeros,
        }
    }

    /// Does all steps by this thread alone.
    pub fn run<C: Constraint>(
        &mut self,
        network: &Network,
        state: &mut State,
        steps: Steps,
        constraint: impl Fn(u32) -> C,
    ) {
        let all = 0..network.node_count();
        self.columns.load(state);
        for step in 0..steps.count {
            let constraint = constraint(step);
            self.impose(0.0, &constraint);
            for part in Part::ALL {
                network.springs.add_to_columns(Arch::new(), part, &mut self.columns);
            }
            self.finish(network, steps.length, all.clone(), &constraint);
        }
        self.columns.store(all, state);
    }

    /// Does all steps for one half, while another thread does those of the other.
    fn run_half<C: Constraint>(&mut self, network: &Network, half: &Half, steps: Steps, constraint: impl Fn(u32) -> C) {
        let arch = Arch::new();
        // A thread that ends early, by a panic, releases the other.
        let _hang_up = HangUp(half.to);
        for step in 0..steps.count {
            let constraint = constraint(step);
            self.impose(0.0, &constraint);
            half.to.send(step, &self.columns, half.seen.clone());
            network.springs.add_to_columns(arch, half.part, &mut self.columns);
            half.from.receive(step, &mut self.columns, half.foreign.clone());
            self.columns.clear_forces(half.foreign.clone());
            network.springs.add_to_columns(arch, Part::Seam, &mut self.columns);
            self.finish(network, steps.length, half.own.clone(), &constraint);
        }
        self.columns.clear_forces(half.foreign.clone());
    }

    /// Completes a step for some nodes, from the springs' forces on.
    fn finish(&mut self, network: &Network, h: f64, nodes: Range<usize>, constraint: &impl Constraint) {
        let arch = Arch::new();
        let Network { mass, inverse_mass, external, .. } = network;
        self.columns.accelerate(arch, mass, inverse_mass, external, nodes.clone());
        // Nodes that another thread moves have no acceleration here; old values must not remain.
        let constrained =
            || constraint.nodes(0.0).iter().map(|&node| node as usize).filter(|node| nodes.contains(node));
        constrained().for_each(|node| self.accelerations[node] = self.columns.force(node));
        constraint.accelerations(&mut self.accelerations);
        constrained().for_each(|node| self.columns.set_force(node, &self.accelerations[node]));
        self.columns.advance(arch, h, nodes.clone());
        self.impose(1.0, constraint);
        self.columns.snap_to_rest(arch, nodes);
    }

    /// Applies a constraint at a fraction of the step.
    fn impose(&mut self, ahead: f64, constraint: &impl Constraint) {
        let nodes = constraint.nodes(ahead);
        for &node in nodes {
            let node = node as usize;
            (self.imposed.x[node], self.imposed.v[node]) = self.columns.node(node);
        }
        constraint.state(ahead, &mut self.imposed);
        for &node in nodes {
            let node = node as usize;
            self.columns.place(node, &self.imposed.x[node], &self.imposed.v[node]);
        }
    }
}

/// Does all steps by two threads; returns `false` and does nothing if the system grants no second thread.
pub(super) fn run_by_two<C: Constraint>(
    workers: [&mut Worker; 2],
    network: &Network,
    halves: &Halves,
    state: &mut State,
    steps: Steps,
    constraint: impl Fn(u32) -> C + Sync,
) -> bool {
    let Halves { split, reach } = halves.clone();
    let (below, above) = (reach.start..split, split..reach.end);
    let (up, down) = (Channel::default(), Channel::default());
    let lower =
        Half { part: Part::Lower, own: 0..split, seen: below.clone(), foreign: above.clone(), to: &up, from: &down };
    let own = split..network.node_count();
    let upper = Half { part: Part::Upper, own, seen: above, foreign: below, to: &down, from: &up };
    let [mine, others] = workers;
    mine.columns.load(state);
    others.columns.load(state);
    let both = thread::scope(|scope| {
        let other =
            thread::Builder::new().spawn_scoped(scope, || others.run_half(network, &upper, steps, &constraint)).is_ok();
        if other {
            mine.run_half(network, &lower, steps, &constraint);
        }
        other
    });
    if both {
        mine.columns.store(lower.own, state);
        others.columns.store(upper.own, state);
    }
    both
}

/// The part of one of two threads.
struct Half<'a> {
    part: Part,
    /// Nodes that the thread moves.
    own: Range<usize>,
    /// Own nodes on which the seam's springs end (`seen`), and such nodes of the other half (`foreign`).
    seen: Range<usize>,
    foreign: Range<usize>,
    to: &'a Channel,
    from: &'a Channel,
}

/// A one-way channel for positions and velocities of some nodes, with one message per step.
#[derive(Default)]
struct Channel {
    /// Number of messages sent so far.
    sent: AtomicU64,
    /// The last two messages, in turns. A thread sends its next message only after the other one's last has arrived,
    /// which the other sent after it had read the last but one: no thread waits for a lock.
    messages: [Mutex<Vec<f64>>; 2],
}

/// Number of looks at a counter before the processor is yielded to other threads.
const SPINS: u32 = 500;

impl Channel {
    fn send(&self, step: u32, columns: &Columns, nodes: Range<usize>) {
        if let Ok(mut message) = self.messages[step as usize % 2].lock() {
            columns.copy_to(nodes, &mut message);
        }
        self.sent.store(u64::from(step) + 1, Ordering::Release);
    }

    fn receive(&self, step: u32, columns: &mut Columns, nodes: Range<usize>) {
        let mut looks = 0;
        while self.sent.load(Ordering::Acquire) <= u64::from(step) {
            looks += 1;
            if looks < SPINS {
                std::hint::spin_loop();
            } else {
                thread::yield_now();
            }
        }
        if let Ok(message) = self.messages[step as usize % 2].lock() {
            columns.copy_from(nodes, &message);
        }
    }
}

struct HangUp<'a>(&'a Channel);

impl Drop for HangUp<'_> {
    fn drop(&mut self) {
        self.0.sent.store(u64::MAX, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::constraint::{Threads, Unconstrained};
    use crate::model::mesh::{Block, Stencil};
    use crate::model::springs::Spring;

    /// Checks that a second thread is really used: otherwise only the computing time would show it.
    #[test]
    fn two_threads_are_had() {
        let mesh = Block { nodes: [11, 10, 9], spacing: 0.0125, stencil: Stencil::Full }.mesh();
        let spring = |&nodes: &[u32; 2]| Spring { nodes, stiffness: 100.0, damping: 0.5, rest_length: 0.0125 };
        let springs: Vec<Spring> = mesh.edges.iter().map(spring).collect();
        let count = mesh.nodes.len();
        let network = Network::from_parts(mesh.nodes, vec![0.01; count], vec![false; count], &springs, vec![]);
        let halves = network.springs.halves().expect("more than 8,192 springs");
        let (mut one, mut two, mut state) = (Worker::new(&network), Worker::new(&network), network.rest_state());
        let steps = Steps { length: 1e-4, count: 3, threads: Threads::Two };
        assert!(run_by_two([&mut one, &mut two], &network, halves, &mut state, steps, |_| Unconstrained));
        let (lower, upper) = state.v.split_at(halves.split);
        assert!([lower, upper].iter().all(|half| half.iter().any(|v| v.norm() > 0.0)), "both have moved");
    }
}
