//! Definitions of contact losses, mode switches, the largest force jump and tunnelling, for everything that reports one
//! of them.

use crate::Vec3;
use crate::contact::law::Mode;
use crate::multirate::timeline::DeadlineOutcome;
use crate::pipeline::TickView;

/// Depth of a free tip inside the surface, m, above which it has tunnelled. Smaller depths are round-off between two
/// tests: collision uses triangle planes, and inside the nearest point.
const TUNNELLED_M: f64 = 1e-12;

/// Measures of the contact over the ticks recorded so far. A loss, a mode switch or a jump needs two successive ticks,
/// so that a recording that begins within a run counts none of them at its first tick.
///
/// ```
/// use stickslip::{output::measures::ContactMeasures, pipeline, scene::Scene};
///
/// // The tip meets the block after 80 ticks.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let mut measures = ContactMeasures::default();
/// pipeline::run(&scene, |tick| measures.record(tick))?;
/// assert_eq!((measures.contact_losses(), measures.mode_switches(), measures.tunnelling_ticks()), (0, 1, 0));
/// let jump = measures.largest_force_jump();
/// assert!(jump.newtons > 0.0 && jump.tick > Some(80)); // the first force follows a tick without contact
/// # Ok::<(), stickslip::pipeline::RunError>(())
/// ```
#[derive(Debug, Clone, Copy, Default)]
pub struct ContactMeasures {
    last: Option<(Mode, Vec3)>,
    contact_losses: u64,
    mode_switches: u64,
    jump: ForceJump,
    jump_at_ends: ForceJump,
    tunnelling_ticks: u64,
}

/// Largest change of the commanded force between two ticks.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ForceJump {
    /// Magnitude of the change, N; NaN from the first force on that is not a number.
    pub newtons: f64,
    /// The later of the two ticks, the earliest if there are several; absent if the force never changed in contact.
    pub tick: Option<u64>,
}

impl ContactMeasures {
    /// Records a tick.
    pub fn record(&mut self, view: &TickView) {
        self.follow(view.tick, view.report.mode, view.force);
        self.tunnelling_ticks += u64::from(is_tunnelling(view));
    }

    fn follow(&mut self, tick: u64, mode: Mode, force: Vec3) {
        let Some((last_mode, last_force)) = self.last.replace((mode, force)) else { return };
        self.mode_switches += u64::from(mode != last_mode);
        let jump = match (last_mode, mode) {
            (Mode::Free, Mode::Free) => return,
            (Mode::Free, _) => &mut self.jump_at_ends,
            (_, Mode::Free) => {
                self.contact_losses += 1;
                &mut self.jump_at_ends
            }
            _ => &mut self.jump,
        };
        let newtons = (force - last_force).norm();
        if !(newtons <= jump.newtons || jump.newtons.is_nan()) {
            *jump = ForceJump { newtons, tick: Some(tick) };
        }
    }

    /// Number of free ticks that follow a tick in contact. In a free tick no contact exerts a force: there is none, or
    /// it is kept under tension. A force of zero in another mode is no loss.
    pub fn contact_losses(&self) -> u64 {
        self.contact_losses
    }

    /// Number of ticks whose mode differs from that of the tick before.
    pub fn mode_switches(&self) -> u64 {
        self.mode_switches
    }

    /// Largest change of the commanded force between two successive ticks in contact. The onset and the loss of contact
    /// count as no jump.
    pub fn largest_force_jump(&self) -> ForceJump {
        self.jump
    }

    /// Largest change of the commanded force in a tick in which contact begins or ends.
    pub fn largest_force_jump_at_ends(&self) -> ForceJump {
        self.jump_at_ends
    }

    /// Number of ticks that [tunnel](is_tunnelling).
    pub fn tunnelling_ticks(&self) -> u64 {
        self.tunnelling_ticks
    }
}

/// Returns whether contact was computed at the tip's present position. In a skipped tick the tip moves on without it.
fn is_seen(view: &TickView) -> bool {
    view.deadline_outcome != DeadlineOutcome::Skipped
}

/// Returns whether the tip is inside the surface at the end of the tick with no force and no contact kept. A distance
/// that is not a number counts as inside. A skipped tick never tunnels: nothing was computed that could have missed the
/// surface.
pub fn is_tunnelling(view: &TickView) -> bool {
    is_seen(view)
        && view.report.mode == Mode::Free
        && view.local.contact().is_none()
        && !(view.local.shape().signed_distance(view.tip) >= -TUNNELLED_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measures(ticks: &[(Mode, f64)]) -> ContactMeasures {
        let mut measures = ContactMeasures::default();
        (0..).zip(ticks).for_each(|(tick, &(mode, force))| measures.follow(tick, mode, Vec3::z() * force));
        measures
    }

    #[test]
    fn a_loss_is_one_of_mode_and_a_jump_lies_within_contact() {
        use Mode::{Free, Slide, Slip, Stick};
        let run =
            measures(&[(Free, 0.0), (Stick, 9.0), (Slide, 0.0), (Slip, 2.0), (Free, 0.0), (Slip, 20.0), (Slip, 22.0)]);
        assert_eq!((run.contact_losses(), run.mode_switches()), (1, 5));
        assert_eq!(run.largest_force_jump(), ForceJump { newtons: 9.0, tick: Some(2) });
        assert_eq!(run.largest_force_jump_at_ends(), ForceJump { newtons: 20.0, tick: Some(5) });
        assert_eq!(measures(&[(Slip, 1.0)]).largest_force_jump(), ForceJump::default());
    }

    #[test]
    fn a_jump_that_is_not_a_number_stays() {
        let run = measures(&[(Mode::Slip, 1.0), (Mode::Slip, f64::NAN), (Mode::Slip, 1.0), (Mode::Slip, 9.0)]);
        let jump = run.largest_force_jump();
        assert!(jump.newtons.is_nan() && jump.tick == Some(1), "{jump:?}");
    }
}
