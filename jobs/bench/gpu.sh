#!/bin/bash
# Compares a GPU with the CPU: rates of the step of large nets, the stadium and 64 of its storms, which must have
# the same bits, and storms a minute.
#
#     bash jobs/bench/gpu.sh [STORMS]     some four minutes, on a machine with netfall[gpu] and a GPU
set -e
shopt -s inherit_errexit # a failed study has no rate
here=$(cd "$(dirname "$0")" && pwd)
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
cd "$here"

# one process, in which all nets of a device have the same compiled kernel
python - "$place" <<'END'
import runpy
import sys
import time

from netfall.__main__ import main

place = sys.argv[1]
for device in ("cpu", "gpu"):
    for size in ("200", "1000"):
        sys.argv[1:] = [size, "all", "--rounds", "3", "--device", device]
        runpy.run_path("step.py")
    sys.argv[1:] = ["run", "../stadium.toml", "--device", device, "-o", f"{place}/{device}.vtkhdf", "--quiet"]
    begin = time.perf_counter()
    main()
    print(f"stadium, {device}: {time.perf_counter() - begin:.2f} s")
END
cd "$place"

same() {
    PYTHONPATH=$here/../../tests python -c '
import sys
from results import differences
lines = [line for line in differences(*sys.argv[1:]) if not line.startswith("samples/seconds")]
sys.exit("\n".join(lines) if lines else print("all datasets have the same bits"))
' "$@"
}
same cpu.vtkhdf gpu.vtkhdf

milliseconds() { # of a study of some storms on a device
    printf 'job = "%s/../stadium.toml"\n[vary]\n"wind.seed" = {from = 1, to = %s}\n' "$here" "$2" > "$2.toml"
    local begin
    begin=$(date +%s%N)
    netfall study "$2.toml" --device "$1" -o "$1-$2.study.h5" --quiet >&2
    echo $((($(date +%s%N) - begin) / 1000000))
}

rate() { # storms of the stadium a minute on a device, from 64 and from more of them
    local few more
    few=$(milliseconds "$1" 64)
    more=$(milliseconds "$1" "$2")
    echo "storms of the stadium a minute, $1: $((60000 * ($2 - 64) / (more - few)))"
}
rate cpu 256
rate gpu "${1:-2000}"
same cpu-64.study.h5 gpu-64.study.h5
