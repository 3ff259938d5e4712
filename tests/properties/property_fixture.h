// SPDX-License-Identifier: Apache-2.0
// rapidcheck with GoogleTest, the same cases every time (RC_PARAMS in the environment says
// otherwise: "seed=7 max_success=10000"), and any of the motions that the lattice has.
#pragma once

#include <rapidcheck.h>

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cstdint>
#include <cstdlib>

#include "tests/support/motions.h"

namespace trocar::test {

/// Before any property runs.
struct FixedSeed {
  FixedSeed() {
    ::setenv("RC_PARAMS", "seed=20 max_success=200", 0);  // NOLINT(concurrency-mt-unsafe)
  }
};
inline const FixedSeed kFixedSeed;

/// In [low, high), alike from the first case to the last: rapidcheck's own range begins at its
/// lower end and reaches the upper one only with the last cases.
template <typename T>
rc::Gen<T> in_range(T low, T high) {
  return rc::gen::resize(rc::kNominalSize, rc::gen::inRange<T>(low, high));
}
template <typename T>
T any_in(T low, T high) {
  return *in_range<T>(low, high);
}

/// Shrinking a seed would only be another case; all 64 bits, whatever the size.
inline std::uint64_t any_seed() {
  return *rc::gen::noShrink(rc::gen::resize(rc::kNominalSize, rc::gen::arbitrary<std::uint64_t>()));
}

/// Far enough that floating-point numbers of absolute places would round otherwise.
inline Motion any_translation() {
  return {0, {any_in(-200'000'000, 200'000'000), any_in(-200'000'000, 200'000'000)}};
}
inline Motion any_motion() {
  Motion out = any_translation();
  out.quarters = any_in(1, 4);
  return out;
}

}  // namespace trocar::test

namespace rc {
template <>
struct Arbitrary<trocar::LatticePoint> {
  /// Small ones often, so that what is degenerate comes often; the lattice's ends sometimes.
  static Gen<trocar::LatticePoint> arbitrary() {
    const auto coordinate = gen::weightedOneOf<std::int32_t>(
        {{4, trocar::test::in_range<std::int32_t>(-4, 5)},
         {2, trocar::test::in_range<std::int32_t>(-1000, 1001)},
         {2, trocar::test::in_range<std::int32_t>(-trocar::kMaxCoordinate,
                                                  trocar::kMaxCoordinate + 1)},
         {1, gen::element<std::int32_t>(-trocar::kMaxCoordinate, trocar::kMaxCoordinate)}});
    return gen::construct<trocar::LatticePoint>(coordinate, coordinate);
  }
};
}  // namespace rc

namespace trocar {
inline void showValue(LatticePoint p, std::ostream& out) {
  out << '(' << p.x << ", " << p.y << ')';
}
}  // namespace trocar
