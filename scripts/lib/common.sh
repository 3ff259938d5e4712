# SPDX-License-Identifier: Apache-2.0
# Sourced by the scripts: paths, messages, building. Sets -euo pipefail.
# No process substitution: a bare chroot may have no /dev/fd.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
me=$(basename "$0")
preset=release
build=${TROCAR_BUILD:-$root/build/$preset}
bin=$build/bin
out=${TROCAR_OUT:-$root/out}

# With ccache installed, clones on one machine share what they compiled (one language of messages, too: ccache tells them apart).
if command -v ccache >/dev/null; then
  export CMAKE_CXX_COMPILER_LAUNCHER=${CMAKE_CXX_COMPILER_LAUNCHER-ccache}
  export CCACHE_BASEDIR=${CCACHE_BASEDIR:-$root} CCACHE_NOHASHDIR=1
fi

say() { printf '%s: %s\n' "$me" "$*" >&2; }

# help_if_asked ARGUMENT...: with -h or --help among them prints $usage and ends with 0.
help_if_asked() {
  local argument
  for argument; do
    case $argument in
      -h | --help)
        echo "$usage"
        exit 0
        ;;
    esac
  done
}

# die CODE MESSAGE: ends with CODE: 1 a bug or a failed step, 2 wrong usage, 3 input refused, 4 not written.
die() {
  local code=$1
  shift
  say "$*"
  exit "$code"
}

# quietly LOG COMMAND...: runs it with its output in LOG; shows the end of LOG if it fails.
quietly() {
  local log=$1
  shift
  mkdir -p "$(dirname "$log")"
  local code=0
  "$@" >"$log" 2>&1 || code=$?
  if ((code != 0)); then
    tail -n 40 "$log" >&2
    say "failed ($code): $* (the whole output: $log)"
  fi
  return "$code"
}

# jobs: how many files to compile at once: one per core, but each can take 2.5 GB of memory.
jobs() {
  local by_memory
  by_memory=$(awk '/^MemAvailable:/ { print int($2 / 2700000) }' /proc/meminfo)
  echo $((by_memory < 1 ? 1 : by_memory < $(nproc) ? by_memory : $(nproc)))
}

# configure_and_build [TARGET...]: the preset $preset; cmake and ninja skip what is up to date. Sources are compiled in batches
# (CMake's unity build), which takes half the time of one by one; TROCAR_UNITY=OFF compiles them one by one. With TROCAR_WERROR=ON,
# as .ci/run sets it, warnings are errors. TROCAR_BENCHES=OFF leaves out the benchmarks.
configure_and_build() {
  local options=("-DCMAKE_UNITY_BUILD=${TROCAR_UNITY:-ON}" "-DTROCAR_BUILD_BENCHES=${TROCAR_BENCHES:-ON}") targets=() steps
  [[ -z ${TROCAR_WERROR:-} ]] || options+=("-DTROCAR_WERROR=$TROCAR_WERROR")
  quietly "$build/configure.log" cmake -S "$root" -B "$build" --preset "$preset" "${options[@]}" ||
    die 1 "the build could not be configured"
  if (($# > 0)); then targets=(--target "$@"); fi
  steps=$(cmake --build "$build" "${targets[@]}" -- -n | sed -n 's|^\[[0-9]*/\([0-9]*\)\].*|\1|p' | tail -n 1)
  # A step takes about nine seconds of one core.
  say "building in ${build#"$root"/}: ${steps:-0} steps on $(nproc) cores, about $((${steps:-0} * 9 / $(nproc) / 60 + 1)) minutes if nothing of it is in ccache"
  env -u LC_ALL -u LC_CTYPE -u LC_MESSAGES LANG=C.UTF-8 cmake --build "$build" --parallel "$(jobs)" "${targets[@]}" || die 1 "the build failed"
}

# npm_packages FOLDER: installs what FOLDER/package-lock.json pins, unless that is there already.
npm_packages() {
  local folder=$1
  cmp -s "$folder/package-lock.json" "$folder/node_modules/.trocar-lock" && return
  quietly "$build/npm.log" npm --prefix "$folder" ci --no-audit --no-fund --ignore-scripts ||
    die 1 "npm could not install the packages of ${folder#"$root"/}"
  cp "$folder/package-lock.json" "$folder/node_modules/.trocar-lock"
}

# fetch_page: the two libraries of the console's page, to vendor/ beside it, with their licences.
fetch_page() {
  local page=$root/runtime/console/page file
  cmp -s "$page/package-lock.json" "$page/vendor/.trocar-lock" && return
  npm_packages "$page"
  rm -rf "$page/vendor"
  mkdir "$page/vendor"
  for file in three/build/three.module.js three/build/three.core.js three/examples/jsm/controls/OrbitControls.js \
    uplot/dist/uPlot.esm.js uplot/dist/uPlot.min.css; do
    cp "$page/node_modules/$file" "$page/vendor/"
  done
  for file in three uplot; do cp "$page/node_modules/$file/LICENSE" "$page/vendor/LICENSE.$file"; done
  cp "$page/package-lock.json" "$page/vendor/.trocar-lock"
}

# prepare_tests: fetches what the tests need besides the sources: three.js, the console's page and what drives a browser, and a
# real scan. Without the scan the end-to-end tests skip that part.
prepare_tests() {
  mkdir -p "$build"
  npm_packages "$root/tests/e2e/three"
  npm_packages "$root/tests/e2e/console"
  fetch_page
  export TROCAR_REQUIRE_THREE=1 TROCAR_REQUIRE_CONSOLE=1
  export TROCAR_HEAD_CT=${TROCAR_HEAD_CT:-$build/head.nii.gz}
  [[ -f $TROCAR_HEAD_CT ]] || "$root/scripts/head-ct" "$TROCAR_HEAD_CT" || say "continuing without the head CT"
}
