// SPDX-License-Identifier: Apache-2.0
// Shared by the benchmarks. A benchmark is named STAGE/CASE/METHOD[/SETTING]; a method peer-NAME is
// not ours. Its counters hold errors (`error_...`) and sizes. scripts/lib/bench_compare.py and
// bench_plot.py read the JSON of Google Benchmark.
#pragma once

#include <benchmark/benchmark.h>

#include <cstdio>
#include <exception>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/take.h"

namespace trocar::bench {

/// NAME=FILE of the command line.
struct Input {
  std::string name, file;
};

using Counters = std::map<std::string, double>;

inline bool quick = false;  ///< few cases: --quick
inline int failures = 0;    ///< the program ends with 1 if not 0

/// Reports a property that must hold on every machine.
inline void check(bool holds, const std::string& what) {
  if (holds) return;
  std::fprintf(stderr, "FAILED: %s\n", what.c_str());
  ++failures;
}

using test::take;

/// A number as %g has it.
inline std::string short_text(double value) {
  char out[32];
  std::snprintf(out, sizeof out, "%g", value);
  return out;
}

/// Adds a benchmark: `work()` is timed; `count()` returns the counters, once, after the first run.
template <typename Work, typename Count>
benchmark::internal::Benchmark* add(const std::string& name, benchmark::TimeUnit unit, Work work,
                                    Count count) {
  auto known = std::make_shared<std::optional<Counters>>();
  return benchmark::RegisterBenchmark(name.c_str(),
                                      [work = std::move(work), count = std::move(count),
                                       known = std::move(known)](benchmark::State& state) mutable {
                                        for (auto _ : state)
                                          work();
                                        if (!*known) *known = count();
                                        for (const auto& [key, value] : **known)
                                          state.counters[key] = value;
                                      })
      ->Unit(unit);
}
template <typename Work>
benchmark::internal::Benchmark* add(const std::string& name, benchmark::TimeUnit unit, Work work) {
  return add(name, unit, std::move(work), [] { return Counters(); });
}

/// main() of a benchmark: [--quick] [NAME=FILE...] and Google Benchmark's options. `add_all(inputs)`
/// adds the benchmarks. Exit codes: 1 a check failed, 2 wrong usage, 3 an input is refused.
template <typename AddAll>
int bench_main(int argc, char** argv, AddAll add_all) {
  benchmark::Initialize(&argc, argv);
  std::vector<Input> inputs;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t equals = word.find('=');
    if (word == "--quick") {
      quick = true;
    } else if (equals == std::string::npos || word.front() == '-') {
      std::fprintf(stderr, "%s: NAME=FILE, not %s\n", argv[0], word.c_str());
      return 2;
    } else {
      inputs.push_back({word.substr(0, equals), word.substr(equals + 1)});
    }
  }
  try {
    add_all(inputs);
    benchmark::RunSpecifiedBenchmarks();
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: %s\n", argv[0], e.what());
    return 3;
  }
  benchmark::Shutdown();
  return failures == 0 ? 0 : 1;
}

}  // namespace trocar::bench
