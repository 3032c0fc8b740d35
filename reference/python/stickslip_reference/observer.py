"""A device's motion between the counts of its encoders, estimated from the readings alone.

Velocity by first-order adaptive windowing: F. Janabi-Sharifi, V. Hayward, C.-S. J. Chen, Discrete-time adaptive windowing
for velocity estimation, IEEE Trans. Control Syst. Technol. 8 (2000).
"""

from collections import deque

import numpy as np

LONGEST = 0.02  # s: longest window, and the time constant by which an angle relaxes to its reading
ROUND_OFF = 1e-9  # of a count, so that a line which misses a reading by exactly a count passes


class Observer:
    """Angles (3,), rad, and rates (3,), rad/s, from readings (3,) of encoders whose counts are `count` (3,), rad."""

    def __init__(self, reading, count, h):
        self.count, self.h = count, h
        self.readings = deque([reading] * (int(np.ceil(LONGEST / h)) + 1), maxlen=int(np.ceil(LONGEST / h)) + 1)
        self.angle, self.rate = reading, np.zeros(3)

    def move(self, reading):
        """Take the reading at a tick's end."""
        self.readings.append(reading)
        newest_first = np.array(self.readings)[::-1]
        self.rate = np.array([steepness(past, count) for past, count in zip(newest_first.T, self.count)]) / self.h
        angle = self.angle + self.rate * self.h
        angle = angle + (reading - self.angle) * min(self.h / LONGEST, 1.0)
        self.angle = np.clip(angle, reading - self.count, reading + self.count)


def steepness(past, count):
    """Slope, rad per tick, of the longest line from the newest reading to an older one that passes all readings between
    within a count. `past` has the newest first."""
    count = count * (1.0 + ROUND_OFF)
    least, most = -np.inf, np.inf
    accepted = past[0] - past[1]
    for ticks in range(1, len(past)):
        way = past[0] - past[ticks]
        least, most = max(least, (way - count) / ticks), min(most, (way + count) / ticks)
        if ticks > 1 and not least <= way / ticks <= most:
            break
        accepted = way / ticks
    return accepted
