#!/bin/bash
# The proof of the GPU backends on a machine with a CUDA device, in at most eight minutes; README.md beside it
# says what to bring.
#
#     benchmarks/gpu/prove.sh OUT [WHEELS]
#     benchmarks/gpu/prove.sh --dry-run OUT [WHEELS]   without a device, tiny, in Triton's interpreter: does it run?
#
# Packages that are missing come from the folder WHEELS, without a network. Every step is a process with a limit of
# its own, and all share one. OUT gets proof.json and proof.txt, which are whole after every step, and three logs.
set -u
cd "$(dirname "$0")/../.."
dry=() slower=1
if [ "${1:-}" = --dry-run ]; then
    dry=(--dry-run) slower=10
    shift
    export TRITON_INTERPRET=1
fi
mkdir -p "${1:?OUT}"
out=$(realpath "$1") wheels=${2:-} limit_s=$((${LIMIT_S:-470} * slower)) python=${PYTHON:-python3}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/steps" "$work/site"
export PYTHONUNBUFFERED=1 PYTHONPATH="$work/site:$PWD:$PWD/clients/python${PYTHONPATH:+:$PYTHONPATH}"
install=("$python" -m pip install --quiet --no-index --no-deps --no-compile --no-cache-dir --target "$work/site")
if [ -n "$wheels" ]; then
    "${install[@]}" "$wheels"/*.whl || exit
fi
: >"$out/steps.log"

step() { # seconds at most, name, backend, name of the result
    local name=${4:-$2-$3} left=$((limit_s - SECONDS - 5)) seconds=$(($1 * slower))
    seconds=$((seconds < left ? seconds : left))
    local file=$work/steps/$name.json
    echo '{"good": false, "unfinished": true, "error": "no time was left, or it did not start"}' >"$file"
    if [ $seconds -gt 5 ]; then
        timeout -k 5 $seconds "$python" benchmarks/gpu/prove.py "$2" "$3" --out "$file" "${dry[@]}" \
            >>"$out/steps.log" 2>&1 ||
            echo "$name ended with code $? (124 and 137: out of its $seconds s)" | tee -a "$out/steps.log"
    fi
    "$python" benchmarks/gpu/report.py "$work/steps" "$out" "$name"
}

check() { # tests of the backends, without fixtures that need other packages: FOLDER [OPTIONS] FILES
    local folder=tests/fvs_engine/$1
    shift
    "$python" -m pytest -v --tb=short -p no:cacheprovider -W default --continue-on-collection-errors \
        ${dry:+--collect-only -q} --rootdir . --confcutdir "$folder" "${@/#@/$folder/}"
}

checks() {
    check splat -m cuda @raster/test_agreement.py
    check splat --ignore-glob='*/test_compile*.py' --ignore-glob='*/test_launch.py' @triton_kernels
    check score -m cuda @test_spectral_median.py @test_median_log_magnitude.py
    check splat @raster/test_triton.py # compiles kernels of the CPU, too
}

if [ ${#dry[@]} -gt 0 ]; then
    "$python" benchmarks/gpu/goldens.py --dry-run && "$python" benchmarks/gpu/launch.py || exit
fi
# While nothing is timed, gsplat compiles, if its source was brought in place of its wheel, and tests run.
compile_gsplat() { # SOURCE: into a wheel that the next run finds
    local built=${TMPDIR:-/tmp}/fvs-gsplat
    if ! ls "$built"/gsplat-*.whl >/dev/null 2>&1; then
        PATH=$work/site/bin:$PATH TORCH_CUDA_ARCH_LIST=${TORCH_CUDA_ARCH_LIST:-9.0} MAX_JOBS=${MAX_JOBS:-12} \
            nice timeout -k 5 270 "$python" -m pip wheel --quiet --no-index --no-deps --no-build-isolation \
            --no-cache-dir -w "$built" "$1"
    fi
    "${install[@]}" "$built"/gsplat-*.whl
}
building=''
if [ -n "$wheels" ] && source=$(ls "$wheels"/gsplat-*.tar.gz 2>/dev/null); then
    compile_gsplat "$source" >"$out/gsplat-build.log" 2>&1 &
    building=$!
fi
step 60 machine none machine
export -f check checks
python=$python dry=${dry[*]} timeout -k 5 150 bash -c checks >"$out/tests.log" 2>&1 &
testing=$!
for name in parity training; do step 100 $name triton; done
for name in optimiser tf32 extremes; do step 60 $name triton; done
wait $testing
passed=$(grep -ac ' PASSED ' "$out/tests.log")
failed=$(grep -acE ' (FAILED|ERROR) |^ERROR|^ImportError' "$out/tests.log")
good=false
if [ "$failed" = 0 ] && [ $((passed + ${#dry[@]})) -gt 0 ]; then good=true; fi
echo "{\"good\": $good, \"passed\": $passed, \"failed\": $failed}" >"$work/steps/tests.json"
"$python" benchmarks/gpu/report.py "$work/steps" "$out" tests
for name in steps scores; do step 75 $name triton; done
step 45 kernels triton
[ -z "$building" ] || wait $building
if [ ${#dry[@]} -gt 0 ]; then
    echo "gsplat has no dry run"
elif ! "$python" -c 'import gsplat.csrc' 2>>"$out/steps.log"; then
    echo "gsplat is not here with its kernels, so nothing was compared with it"
else
    for name in steps scores; do step 75 $name gsplat; done
    step 75 steps triton steps-triton-again # so that the two were timed in turns
    for name in parity training kernels; do step 45 $name gsplat; done
fi
cat "$out/proof.txt"
grep -q '^ok ' "$out/proof.txt" && ! grep -q '^BAD ' "$out/proof.txt"
