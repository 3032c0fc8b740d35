#!/usr/bin/env python3
"""Compares the memory that `stickslip explain` estimates with the largest resident memory of a run.

    cargo build --release
    python3 benches/memory.py target/release/stickslip [PATTERN]

The estimate decides before a run whether it fits, so it has to be within a factor of 1.5 both ways.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

SCENE = """name = "memory"
duration = {duration}
{top}
[mesh]
nodes = {nodes}
spacing = 0.0125
[material]
node_mass = 0.01
stiffness = 100.0
damping = 0.5
{material}
[global]
rate = 100.0
substeps = 2
{network}
[local]
{local}
[contact]
law = "sliding"
{contact}
[instrument]
waypoints = [[0.0, 0.0, 0.001, 0.004], [0.02, 0.0, 0.001, 0.001]]
"""
FACTOR = 1.5
IMPLICIT = {"network": 'integrator = "implicit-euler"'}
SETTLED = {"top": "settle = true", "material": "gravity = [0.0, 0.0, -0.1]"}
CONDENSED = {"local": 'exterior = "condensed"'}
VELOCITY = 'scheme = "velocity"'
CASES = [
    ("network alone", [20, 20, 8], {}),
    ("network alone", [60, 60, 16], {}),
    ("implicit network", [10, 10, 6], IMPLICIT),
    ("implicit network", [28, 28, 10], IMPLICIT),
    ("equilibrium", [20, 20, 8], SETTLED),
    ("condensed exterior", [20, 20, 8], CONDENSED),
    ("condensed exterior", [40, 40, 12], CONDENSED),
    ("patch of all nodes", [14, 14, 5], {"local": 'rings = "all"'}),
    ("patch of 4 rings", [30, 30, 8], {"local": "rings = 4"}),
    ("exponential, 3 rings", [20, 20, 8], {"local": 'rings = 3\nintegrator = "exponential"', "contact": VELOCITY}),
    ("implicit, 4 rings", [20, 20, 8], {"local": 'rings = 4\nintegrator = "implicit-euler"', "contact": VELOCITY}),
    ("two million ticks", [3, 3, 2], {"duration": 2000.0}),
]


def main():
    program, pattern = Path(sys.argv[1]).resolve(), sys.argv[2] if len(sys.argv) > 2 else ""
    blank = dict.fromkeys(("top", "material", "network", "local", "contact"), "")
    beyond = 0
    print(f"{'case':24}{'nodes':>16}{'measured, MiB':>15}{'estimated, MiB':>16}{'ratio':>7}")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder, "scene.toml")
        for name, nodes, settings in CASES:
            if not re.search(pattern, name):
                continue
            scene.write_text(SCENE.format(**{**blank, "duration": 0.02, "nodes": nodes, **settings}))
            explained = subprocess.run([program, "explain", scene, "--json"], capture_output=True, check=True).stdout
            estimated = json.loads(explained)["sizes"]["memory_estimate_mib"]
            run = [program, "run", scene, "--out", Path(folder, "out"), "--quiet"]
            process = subprocess.Popen(run, stderr=subprocess.DEVNULL)
            _, status, usage = os.wait4(process.pid, 0)
            if os.waitstatus_to_exitcode(status) != 0:
                sys.exit(f"{name}, {nodes}: exit code {os.waitstatus_to_exitcode(status)}")
            measured = usage.ru_maxrss / 1024
            ratio = estimated / measured
            beyond += not 1 / FACTOR <= ratio <= FACTOR
            print(f"{name:24}{str(nodes):>16}{measured:15.1f}{estimated:16.1f}{ratio:7.2f}", flush=True)
    sys.exit(f"{beyond} estimates are off by more than a factor of {FACTOR}" if beyond else 0)


if __name__ == "__main__":
    main()
