"""Compile flags of all kernels, in one place.

No fast-math: sums keep their order, so that the bits do not depend on the number of ranks. numpy's error
model: a division by zero gives inf and not an exception (and does not stop vectorisation).
"""

import contextlib
import fcntl
import gc
import hashlib
import os
import shutil
import time
from pathlib import Path

import llvmlite.binding
import numba
from numba.core import registry
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys

from netfall.ground.handed import handed, whole
from netfall.ground.passes import ApartPipeline, Pipeline
from netfall.ground.quicker import quicken

KEPT_DAYS = 30  # of compiled code that these sources did not make; a run of theirs may still be going on
PACKAGE = Path(__file__).parents[1]
MECHANICS = PACKAGE / "mechanics"  # whose files have constants of kernels


def _choose_cache() -> str:
    """Folder of the code compiled from these very sources; that of versions that nobody runs is removed.

    numba looks only at the file of the function that is called, and would run on with an old law after a
    change in another file. So the folder's name covers every file that has kernels, or constants of theirs.
    """
    files = [(path, path.read_bytes()) for path in _sources()]
    compiled = b"".join(text for path, text in files if b"kernel" in text or MECHANICS in path.parents)
    parent = Path(numba.config.CACHE_DIR or PACKAGE / "__pycache__")
    folder = parent / f"netfall-{hashlib.sha256(compiled).hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # installed where nobody may write
        parent = Path.home() / ".cache" / "netfall"
        folder = parent / folder.name
    for old in parent.glob("netfall-*"):
        with contextlib.suppress(OSError):  # another rank may be removing it
            if old != folder and time.time() - old.stat().st_mtime > KEPT_DAYS * 86400:
                shutil.rmtree(old, ignore_errors=True)
    return str(folder)


def _sources() -> list[Path]:
    """The files of the package in order, without a look into caches, which may hold thousands."""
    found = []
    for folder, below, names in os.walk(PACKAGE):
        below[:] = [name for name in below if name != "__pycache__"]
        found += [Path(folder, name) for name in names if name.endswith(".py")]
    return sorted(found)


numba.config.CACHE_DIR = _choose_cache()


class FileForEach(IndexDataCacheFile):
    """Compiled code on disk, each version in a file named by a digest of what it was compiled for.

    numba's own class numbers the files and keeps the numbers in an index. Two processes that compile at the
    same time take the same number, and from then on one version is loaded for the other.
    """

    def save(self, key, data):
        """Write one version, whole or not at all; if two processes write the same one, the last stays."""
        self._save_data(self._name(key), (self._source_stamp, key, data))

    def load(self, key):
        """One version; None if there is none that was made of this very source."""
        try:
            stamp, kept, data = self._load_data(self._name(key))
        except OSError:
            return None
        return data if (stamp, kept) == (self._source_stamp, key) else None

    def flush(self):
        """Forget all versions of the function."""
        for path in Path(self._cache_path).glob(self._stem + ".*"):
            path.unlink(missing_ok=True)

    @property
    def _stem(self) -> str:
        return self._index_name.removesuffix(".nbi")

    def _name(self, key) -> str:
        return f"{self._stem}.{hashlib.sha256(repr((self._version, key)).encode()).hexdigest()[:24]}"


class _Cache(FunctionCache):
    """numba's cache of a function's versions, but with a file for each.

    Of several processes that lack a version, such as the ranks of a first run, one compiles it.
    """

    def __init__(self, function):
        super().__init__(function)
        index = self._cache_file
        self._cache_file = FileForEach(self.cache_path, self._impl.filename_base, index._source_stamp)
        self._turns = {}  # by signature: to compile it

    def load_overload(self, sig, target_context):
        """One version; None if it is this process that has to compile it."""
        found = self._load(sig, target_context)
        if found is None and sig not in self._turns:
            name = self._cache_file._name(self._index_key(sig, target_context.codegen()))
            self._turns[sig] = turn(Path(self.cache_path, f"{name}.lock"))
            found = self._load(sig, target_context)
            if found is not None:
                self._end_turn(sig)
        return found

    def _load(self, sig, target_context):
        """One version; None if there is none. numba loads the compiler first, a sixth of a start."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def save_overload(self, sig, data):
        """Write one version, for which others may wait."""
        super().save_overload(sig, data)
        self._end_turn(sig)

    def _end_turn(self, sig):
        lock = self._turns.pop(sig, None)
        if lock:
            lock.close()


def turn(path: Path, longest: float = 300.0):
    """The file of a lock, open and locked until it is closed; None where there are no locks.

    longest : s to wait for another process, which may have been stopped in the middle
    """
    try:
        lock = path.open("w")
    except OSError:
        return None
    end = time.monotonic() + longest
    while time.monotonic() < end:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except BlockingIOError:
            time.sleep(0.02)
        except OSError:
            break
    lock.close()
    return None


class _Kernel(CPUDispatcher):
    """A function that Python calls: compiled at its first call with arguments of these types, or loaded.

    Kernels that call it are given its `part` instead, which takes less than half the time to compile.
    """

    @property
    def _numba_type_(self):
        return self.part._numba_type_

    def compile(self, sig):
        """Without looks for garbage meanwhile, in all that numba has in memory: a tenth of the time."""
        looks = gc.isenabled()
        gc.disable()
        try:
            return super().compile(sig)
        finally:
            if looks:
                gc.enable()


class _Apart(_Kernel):
    """A function that kernels call by its address (`apart.call`)."""

    def address_for(self, kinds: tuple) -> int:
        """Where it begins, for arguments of these types, named tuples `handed` on; compiled or loaded."""
        self.compile(kinds)
        made = self.overloads[kinds]
        return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)


class _Part(CPUDispatcher):
    """A function that only kernels call: a part of them, and kept with them alone."""

    def __call__(self, *args, **kwargs):
        raise TypeError(f"{self.py_func.__qualname__} can be called by kernels alone")

    def get_call_template(self, args, kws):
        """For a call with named tuples by their address, but whole where no two arrays may overlap."""
        taken = whole if self.targetoptions.get("noalias") else handed
        return super().get_call_template(
            tuple(map(taken, args)), {name: taken(kind) for name, kind in kws.items()}
        )


def _compiled(**flags):
    """Decorator that makes a function a kernel, or a part of kernels where the flags say so."""

    def decorate(function):
        dispatcher = numba.njit(**flags)(function)
        apart = flags["pipeline_class"] is ApartPipeline
        if flags.get("no_cpython_wrapper") and not apart:
            dispatcher.__class__ = _Part
        else:
            dispatcher.__class__ = _Apart if apart else _Kernel
            dispatcher._cache = _Cache(function)
            dispatcher.part = None if apart else _compiled(**flags, **INNER)(function)
        return dispatcher

    return decorate


quicken()
FLAGS = {"error_model": "numpy", "fastmath": False, "pipeline_class": Pipeline, "no_cfunc_wrapper": True}
INNER = {"no_cpython_wrapper": True}  # a third of the time to compile goes into ways in from Python

# Hardware gathers are a trap on processors whose microcode was mended against leaks through them: four
# times slower there than plain loads into the lanes of a vector, which are as fast elsewhere or nearly so.
# And where there are registers of 512 bits, the step is a third faster with them, also on processors for
# which the compiler prefers halves.
numba.config.CPU_FEATURES = (
    numba.config.CPU_FEATURES or llvmlite.binding.get_host_cpu_features().flatten()
) + ",+prefer-no-gather,-prefer-256-bit"

# The compiler vectorises a loop that reads x of neighbours and writes v only if it knows that the two are
# different arrays. numba has the flag (its own parallel loops use it) but gives it no name in the
# decorator: this does.
CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")

allocating_kernel = _compiled(**FLAGS)
# What makes no arrays needs no count of their owners, which would take a microsecond of every step.
kernel = _compiled(**FLAGS, _nrt=False)
# What kernels call by its address, once in many steps.
kernel_apart = _compiled(**FLAGS | {"pipeline_class": ApartPipeline}, **INNER, _nrt=False)
# That, and Python.
kernel_both_ways = _compiled(**FLAGS | {"pipeline_class": ApartPipeline}, _nrt=False)
# The other three are for kernels to call.
inner_kernel = _compiled(**FLAGS, **INNER, _nrt=False)
# A call within a loop would keep it from being vectorised.
part_of_kernel = _compiled(**FLAGS, **INNER, _nrt=False, forceinline=True)
# No two array arguments may overlap if either is written.
vector_kernel = _compiled(**FLAGS, **INNER, _nrt=False, noalias=True)


def once_for(what) -> Path:
    """The file that says that all is compiled for something, by these sources for such a processor."""
    processor = registry.cpu_target.target_context.codegen().magic_tuple()
    name = hashlib.sha256(repr((what, processor)).encode()).hexdigest()[:24]
    return Path(numba.config.CACHE_DIR, f"{name}.done")


def entry_for(function, *arguments):
    """A kernel that was called with these arguments, for calls with others of the very same types.

    The kernel itself looks at the type of each array of each named tuple first: with a hundred of them that
    is three quarters of a call.
    """
    versions = getattr(function, "overloads", None)  # none where kernels run as plain Python
    return versions[tuple(map(numba.typeof, arguments))].entry_point if versions else function


@kernel
def _nothing():
    return 0


def wake() -> None:
    """Pay for the first call of compiled code, some 0.3 s, at a time when there is nothing else to do."""
    _nothing()
