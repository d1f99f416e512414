"""A process that compiles all kernels into numba's cache, beside the node, and ends with it however that ends."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Sequence
from pathlib import Path

from polymap_ros.parameters import Parameters

_CODE = 'import sys; sys.path[:] = {path!r}; from polymap_ros.node.compiling import main; main(sys.argv[1:])'
"""With the node's own path, whatever folder it was started in; the process knows nothing of ROS."""


class CompilingProcess:
    """Compiles what the parameters ask for.

    In a session of its own, so that Ctrl-C reaches the node alone, which then stops it. Where the node is killed, its
    end of the pipe to standard input closes, which the process waits for.

    Parameters
    ----------
    parameters : Parameters
        As the node has them.

    Raises
    ------
    OSError
        Where it cannot be started.
    """

    def __init__(self, parameters: Parameters) -> None:
        arguments = [json.dumps(parameters.flat()), str(parameters.folder)]
        self._process = subprocess.Popen(
            [sys.executable, '-c', _CODE.format(path=sys.path), *arguments], stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors='replace', start_new_session=True)

    def wait(self) -> str:
        """Wait for its end; return why it failed, which is empty where it did not."""
        with self._process as process:
            assert process.stderr is not None, 'it is a pipe'
            said = process.stderr.read().split('\n')
        if process.returncode >= 0:
            return next((line for line in reversed(said) if line.strip()), 'no reason told') if process.returncode \
                else ''
        return f'ended by {signal.Signals(-process.returncode).name}'

    def stop(self) -> None:
        """End it now."""
        self._process.kill()


def main(arguments: Sequence[str]) -> None:
    """Compile for parameters (JSON, and the folder that their file names are relative to), until stdin closes."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    from polymap_ros.jit import NotKept

    warnings.simplefilter('error', NotKept)  # no use in compiling for nobody
    from polymap_ros.mapping.warm_up import warm_up
    from polymap_ros.pulse_file import read_pulse

    values, folder = arguments
    parameters = dataclasses.replace(Parameters().replaced(json.loads(values)), folder=Path(folder))
    warm_up(parameters, read_pulse(parameters))


def _end_with_parent() -> None:
    while os.read(0, 1):
        pass
    os.kill(os.getpid(), signal.SIGKILL)
