"""A process that is stuck ends in time all the same, with the exit code of its signal and what matters closed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from tests.atw_mcp.connections import REPOSITORY

PROGRAM = """
import threading, time
from atw_mcp.transports.ending import ending_in_order

stopped = threading.Event()
with ending_in_order(stopped.set, seconds=0.2) as ending:
    ending.last_resort = lambda: print("closed", flush=True)
    print("ready", flush=True)
    stopped.wait()
    if {stuck}:
        threading.Thread(target=time.sleep, args=(60,)).start()  # the interpreter waits for it
    print("stopped", flush=True)
raise SystemExit(ending.exit_code)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends signals")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("stuck", [True, False])
def test_a_process_ends_in_time_and_says_by_which_signal(number: signal.Signals, stuck: bool) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(stuck=stuck)],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 128 + number
    assert out == ("stopped\nclosed\n" if stuck else "stopped\n")
    assert err == ("atw-mcp: ended with calls unfinished\n" if stuck else "")
