"""Long calls: other threads go on, progress is reported, and Ctrl-C ends them."""

import os
import signal
import subprocess
import threading
import time

import pytest
import stickslip

#: Seconds of computing; no test waits for its end, unless it fails.
LONG = stickslip.Scene.shipped("fig3-sliding").with_keys(duration=600.0)


class Enough(Exception):
    """Ends a call from its progress."""


def test_other_threads_go_on_and_progress_may_end_a_run():
    begin, amounts, counts = time.monotonic(), [], 0
    over = threading.Event()

    def count():
        nonlocal counts
        while not over.wait(0.001):
            counts += 1

    def progress(done, total):
        amounts.append((done, total))
        if time.monotonic() > begin + 0.5:
            raise Enough

    thread = threading.Thread(target=count)
    thread.start()
    with pytest.raises(Enough):
        stickslip.run(LONG, progress=progress)
    counted = counts
    over.set()
    thread.join()
    # With the lock held it would have counted at most once per report of progress.
    assert counted > 3 * len(amounts) > 0
    assert amounts == sorted(amounts) and amounts[0][1] == LONG.tick_count


@pytest.fixture
def interruptible():
    # A shell's background jobs begin with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("renderer", [None, "python"])
def test_ctrl_c_ends_a_run(renderer, penalty, interruptible):
    # From another process: a thread of this one would need the interpreter's lock.
    with subprocess.Popen(["sh", "-c", f"sleep 0.3; kill -INT {os.getpid()}"]):
        with pytest.raises(KeyboardInterrupt):
            stickslip.run(LONG, renderer=renderer and penalty)


def test_progress_bars(capsys):
    scene = LONG.with_keys(duration=0.05)
    stickslip.run(scene, progress=False)
    stickslip.run(scene)
    assert capsys.readouterr().err == "", "standard error is no terminal"
    stickslip.run(scene, progress=True)
    assert "fig3-sliding" in capsys.readouterr().err
    done = []
    stickslip.run(scene, progress=lambda *amounts: done.append(amounts))
    assert done[-1] == (50, 50)
