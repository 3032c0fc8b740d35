//! Contact losses, changes of mode, the largest force jump and tunnelling: the definition of each, for everything that
//! reports one of them.

use crate::Vec3;
use crate::contact::law::Mode;
use crate::pipeline::TickView;

/// Depth of a free tip inside the surface, m, from which it has passed through. Less is the round-off of two different
/// tests: collision by triangle planes, inside by the nearest point.
const TUNNELLED_M: f64 = 1e-12;

/// Measures of the contact over the ticks recorded so far. Two successive ticks are needed for a loss, a change of mode
/// or a jump, so that a recording that begins within a run counts none of them at its first tick.
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
    tunnelling_ticks: u64,
}

/// Largest change of the commanded force between two ticks in contact.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ForceJump {
    /// Its magnitude, N; NaN from the first force on that is not a number.
    pub newtons: f64,
    /// The later of the two ticks, the earliest if there are several; absent if the force never changed in contact.
    pub tick: Option<u64>,
}

impl ContactMeasures {
    /// Takes in a tick.
    pub fn record(&mut self, view: &TickView) {
        self.follow(view.tick, view.report.mode, view.force);
        self.tunnelling_ticks += u64::from(is_tunnelling(view));
    }

    fn follow(&mut self, tick: u64, mode: Mode, force: Vec3) {
        let Some((last_mode, last_force)) = self.last.replace((mode, force)) else { return };
        self.mode_switches += u64::from(mode != last_mode);
        match (last_mode, mode) {
            (Mode::Free, _) => {}
            (_, Mode::Free) => self.contact_losses += 1,
            _ => {
                let newtons = (force - last_force).norm();
                if !(newtons <= self.jump.newtons || self.jump.newtons.is_nan()) {
                    self.jump = ForceJump { newtons, tick: Some(tick) };
                }
            }
        }
    }

    /// Times that a tick in contact was followed by a free one. Free is a tick whose contact exerts no force: there is
    /// none, or it is kept under tension. A force of zero in another mode is no loss.
    pub fn contact_losses(&self) -> u64 {
        self.contact_losses
    }

    /// Times that a tick had another mode than the one before.
    pub fn mode_switches(&self) -> u64 {
        self.mode_switches
    }

    /// The largest change of the commanded force between two successive ticks that are both in contact. Where contact
    /// begins or is lost the force starts or stops, which is no jump of it.
    pub fn largest_force_jump(&self) -> ForceJump {
        self.jump
    }

    /// Ticks that [tunnelled](is_tunnelling).
    pub fn tunnelling_ticks(&self) -> u64 {
        self.tunnelling_ticks
    }
}

/// Whether the tip is inside the surface at the end of the tick, with no force and no contact kept. A distance that is
/// not a number counts as inside.
pub fn is_tunnelling(view: &TickView) -> bool {
    view.report.mode == Mode::Free
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
        assert_eq!(measures(&[(Slip, 1.0)]).largest_force_jump(), ForceJump::default());
    }

    #[test]
    fn a_jump_that_is_not_a_number_stays() {
        let run = measures(&[(Mode::Slip, 1.0), (Mode::Slip, f64::NAN), (Mode::Slip, 1.0), (Mode::Slip, 9.0)]);
        let jump = run.largest_force_jump();
        assert!(jump.newtons.is_nan() && jump.tick == Some(1), "{jump:?}");
    }
}
