"""`netfall run` as a child of another process, such as that of a notebook.

    python -m netfall.driver.child_process run JOB ...

Standard input is a pipe that the parent keeps open. It is closed if the parent requests a stop or ends. The
run then stops as at a signal.
"""

import os
import signal
import threading

from netfall.__main__ import main
from netfall.core.launch import launched_rank


def _stop_with_input() -> None:
    """Wait for the end of standard input, then signal this process to stop."""
    while os.read(0, 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    if launched_rank() == 0:  # mpirun passes standard input to rank 0 only
        threading.Thread(target=_stop_with_input, daemon=True).start()
    main()
