//! Joint velocities from encoder counts, by adaptive windowing.
//!
//! The difference of two readings over a tick is off by one count over the tick: 30 mm/s at the tip at 1 kHz, and 0.3 m/s
//! at 10 kHz. Averaging over a fixed window trades that for delay. First-order adaptive windowing (Janabi-Sharifi,
//! Hayward & Chen 2000, *IEEE Trans. Control Systems Technology* 8(6)) takes the longest window in which the line from
//! its first reading to its last passes all readings within one count: long at rest, short in fast motion. It needs no
//! model of the hand, as an observer would, and its noise at rest is one count over the longest window.

use crate::Vec3;

/// Longest window, s. At rest the velocity of one count at the tip is then below 1.5 mm/s; in slow motion the estimate is
/// half of this late. 20 ms is a tenth of the time in which a hand changes its aim.
const LONGEST_WINDOW_S: f64 = 0.02;

/// Estimator of joint velocities.
///
/// ```
/// use stickslip::{Vec3, device::phantom::velocity::AdaptiveWindow};
///
/// let (tick_s, count) = (1e-4, 1e-4);
/// let mut window = AdaptiveWindow::new(tick_s, Vec3::repeat(count), Vec3::zeros());
/// let read = |angle: f64| Vec3::x() * ((angle / count).round() * count);
/// let mut velocity = Vec3::zeros();
/// for tick in 1..1000 {
///     velocity = window.next(read(0.5 * tick_s * f64::from(tick))); // half a count per tick
/// }
/// assert!((velocity.x - 0.5).abs() < 0.02); // differences alternate between 0 and 1 rad/s
/// let stopped = read(0.5 * tick_s * 999.0);
/// for _ in 0..200 {
///     velocity = window.next(stopped);
/// }
/// assert_eq!(velocity, Vec3::zeros());
/// ```
#[derive(Debug, Clone)]
pub struct AdaptiveWindow {
    tick_s: f64,
    /// Size of a count at each joint, rad; 0 without quantisation.
    count: Vec3,
    /// The last readings, in a ring.
    readings: Vec<Vec3>,
    /// Place of the latest reading in the ring.
    latest: usize,
}

impl AdaptiveWindow {
    /// Starts at rest. `tick_s` is the time between readings, s, and `count` the size of a count at each joint, rad.
    pub fn new(tick_s: f64, count: Vec3, at: Vec3) -> Self {
        let length = (LONGEST_WINDOW_S / tick_s).ceil().max(1.0) as usize + 1;
        Self { tick_s, count, readings: vec![at; length], latest: 0 }
    }

    /// Takes the next reading of the joints, rad. Returns their velocities, rad/s.
    pub fn next(&mut self, reading: Vec3) -> Vec3 {
        self.latest = (self.latest + 1) % self.readings.len();
        self.readings[self.latest] = reading;
        Vec3::from_fn(|joint, _| self.slope(joint) / self.tick_s)
    }

    /// Slope of the longest line that fits, rad per tick.
    fn slope(&self, joint: usize) -> f64 {
        let length = self.readings.len();
        let now = self.readings[self.latest][joint];
        // Slopes of lines from the latest reading that pass all readings so far within a count.
        let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut best = 0.0;
        for back in 1..length {
            let passed = now - self.readings[(self.latest + length - back) % length][joint];
            let (ticks, slope) = (back as f64, passed / back as f64);
            (least, most) =
                (least.max((passed - self.count[joint]) / ticks), most.min((passed + self.count[joint]) / ticks));
            if back > 1 && !(least <= slope && slope <= most) {
                break;
            }
            best = slope;
        }
        best
    }
}
