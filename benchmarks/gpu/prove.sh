#!/bin/bash
# The proof of the GPU backends on a machine with a CUDA device, in at most eight minutes:
#
#     python benchmarks/gpu/goldens.py --model MODEL --images IMAGES     (before, on a CPU)
#     benchmarks/gpu/prove.sh [OUT] [WHEELS]
#
# Needs Python 3.12, PyTorch with CUDA and Triton; packages that are missing come from the folder WHEELS, without a
# network. For gsplat it also needs nvcc, setuptools, and the source (gsplat-1.5.3.tar.gz) in WHEELS. Every step is a process with a limit of its own. OUT gets a JSON file per step and proof.json.
set -u
cd "$(dirname "$0")/../.."
out=${1:-out/proof} wheels=${2:-}
python=${PYTHON:-python3}
mkdir -p "$out"
export PYTHONUNBUFFERED=1 PYTHONPATH="$PWD:$PWD/clients/python${PYTHONPATH:+:$PYTHONPATH}"
if [ -n "$wheels" ]; then
    $python -m pip install --quiet --no-index --no-deps --target "$out/site" "$wheels"/*.whl || exit
    export PYTHONPATH="$PYTHONPATH:$out/site"
fi

# gsplat compiles for minutes: it does so beside the steps of triton, and is tried with what is left.
if [ -n "$wheels" ] && ls "$wheels"/gsplat-*.tar.gz >/dev/null 2>&1; then
    MAX_JOBS=10 timeout 240 $python -m pip install --no-index --no-deps --no-build-isolation --target "$out/site" \
        "$wheels"/gsplat-*.tar.gz >"$out/gsplat-build.log" 2>&1 &
fi

step() { # seconds, name, backend
    timeout "$1" $python benchmarks/gpu/prove.py "$2" "$3" --out "$out" ||
        echo "{\"good\": false, \"error\": \"ended with $? (124: out of time)\"}" >"$out/$2-$3.json"
}

for name in parity tf32 optimiser training scores steps memory; do step 90 "$name" triton; done
wait
if $python -c 'import gsplat.csrc' 2>/dev/null; then
    for name in parity training steps scores; do step 60 "$name" gsplat; done
    step 60 steps triton # again, so that the two were timed in turns
fi
if $python -c 'import pytest' 2>/dev/null; then
    timeout 120 $python -m pytest -q -m cuda -p no:randomly tests/fvs_engine >"$out/tests.log" 2>&1
    tail -3 "$out/tests.log"
fi
$python benchmarks/gpu/prove.py table --out "$out"
