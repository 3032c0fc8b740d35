//! Joint angles and rates from encoder counts, finer than a count.
//!
//! *Rates.* The difference of two readings over a tick is off by one count over the tick: 30 mm/s at the tip at 1 kHz,
//! 0.3 m/s at 10 kHz. Averaging over a fixed window trades that for delay. First-order adaptive windowing (Janabi-Sharifi,
//! Hayward & Chen 2000, *IEEE Trans. Control Systems Technology* 8(6)) takes the longest window in which the line from
//! its first reading to its last passes all readings within one count: long at rest, short in fast motion. It needs no
//! model of the hand, as a Kalman filter would, and its noise at rest is one count over the longest window.
//!
//! *Angles.* A reading says only that the joint is within half a count of it. The estimate advances at the estimated rate,
//! relaxes towards the reading with the longest window as its time constant, and is kept within one count of it. A joint
//! near the boundary between two counts makes the encoder jump back and forth; the estimate then stays between the two,
//! and does not jump. It is never further from the joint than a count and a half.

use crate::Vec3;

/// Longest window, s. One count of 0.03 mm at the tip then gives a velocity of 1.5 mm/s at rest; in slow motion the rate is
/// late by half the window. 20 ms is a tenth of the time in which a hand changes its aim.
pub const LONGEST_WINDOW_S: f64 = 0.02;

/// Round-off of a difference of readings, relative to a count: 1e4 counts at most, with 1e-16 each, leave 1e-12.
const ROUND_OFF: f64 = 1e-9;

/// Estimator of joint angles and rates.
///
/// ```
/// use stickslip::{Vec3, device::phantom::observer::EncoderObserver};
///
/// let (tick_s, count) = (1e-4, 1e-4);
/// let read = |angle: f64| Vec3::x() * ((angle / count).round() * count);
/// let mut observer = EncoderObserver::new(tick_s, Vec3::repeat(count), Vec3::zeros());
/// let mut angle = 0.0;
/// for _ in 0..1000 {
///     angle += 0.5 * tick_s; // half a count per tick
///     observer.next(read(angle));
/// }
/// assert!((observer.rates().x - 0.5).abs() < 0.02); // differences alternate between 0 and 1 rad/s
/// assert!((observer.angles().x - angle).abs() <= 1.5 * count);
///
/// // A joint on the boundary between two counts: the reading jumps, the estimate does not.
/// for tick in 0..400 {
///     observer.next(Vec3::x() * (count * f64::from(600 + tick % 2)));
/// }
/// let before = observer.angles();
/// observer.next(Vec3::x() * (count * 600.0));
/// assert!((observer.angles() - before).norm() < 0.02 * count);
/// ```
#[derive(Debug, Clone)]
pub struct EncoderObserver {
    tick_s: f64,
    /// Size of a count at each joint, rad; 0 without quantisation.
    count: Vec3,
    /// The last readings, in a ring.
    readings: Vec<Vec3>,
    /// Place of the latest reading in the ring.
    latest: usize,
    angles: Vec3,
    rates: Vec3,
}

impl EncoderObserver {
    /// Starts at rest at a reading, rad. `tick_s` is the time between readings, s, and `count` the size of a count at each
    /// joint, rad.
    pub fn new(tick_s: f64, count: Vec3, reading: Vec3) -> Self {
        let length = (LONGEST_WINDOW_S / tick_s).ceil().max(1.0) as usize + 1;
        let readings = vec![reading; length];
        Self { tick_s, count, readings, latest: 0, angles: reading, rates: Vec3::zeros() }
    }

    /// Takes the next reading of the joints, rad.
    pub fn next(&mut self, reading: Vec3) {
        self.latest = (self.latest + 1) % self.readings.len();
        self.readings[self.latest] = reading;
        self.rates = Vec3::from_fn(|joint, _| self.slope(joint) / self.tick_s);
        let count = self.count;
        let moved = self.angles
            + self.rates * self.tick_s
            + (reading - self.angles) * (self.tick_s / LONGEST_WINDOW_S).min(1.0);
        self.angles =
            moved.zip_zip_map(&(reading - count), &(reading + count), |angle, least, most| angle.clamp(least, most));
    }

    /// Estimated joint angles, rad.
    pub fn angles(&self) -> Vec3 {
        self.angles
    }

    /// Estimated joint rates, rad/s.
    pub fn rates(&self) -> Vec3 {
        self.rates
    }

    /// Slope of the longest line that passes all its readings within one count, rad per tick.
    fn slope(&self, joint: usize) -> f64 {
        let length = self.readings.len();
        let now = self.readings[self.latest][joint];
        // Readings are whole counts to round-off: a line that misses one by exactly a count has to pass.
        let count = self.count[joint] * (1.0 + ROUND_OFF);
        // Slopes of lines from the latest reading that pass all readings so far within a count.
        let (mut least, mut most) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut best = 0.0;
        for back in 1..length {
            let passed = now - self.readings[(self.latest + length - back) % length][joint];
            let ticks = back as f64;
            let slope = passed / ticks;
            (least, most) = (least.max((passed - count) / ticks), most.min((passed + count) / ticks));
            if back > 1 && !(least <= slope && slope <= most) {
                break;
            }
            best = slope;
        }
        best
    }
}
