// SPDX-License-Identifier: Apache-2.0
// A spring that yields: it is elastic up to a limit force, and beyond that its force is constant.
// The spring's energy as a function of its extension is the function of Huber (1964).
#pragma once

namespace trocar::runtime {

/// Energy, force, and second derivatives of the energy along the spring and across it.
struct YieldSpring {
  double energy = 0, force = 0, along = 0, across = 0;
};

/// Evaluates a spring. `most`: the force at which the spring yields. `length`: the spring's
/// extension, at least 0. If `majorise` is true, the second derivative along the spring is that of
/// a parabola that touches the energy at `length` and lies above the energy everywhere else. (If
/// Newton's method fails with the true derivative, it uses this one.)
inline YieldSpring yield_spring(double stiffness, double most, double length,
                                bool majorise) noexcept {
  if (stiffness * length <= most)
    return {0.5 * stiffness * length * length, stiffness * length, stiffness, stiffness};
  const double across = most / length;
  return {most * length - 0.5 * most * most / stiffness, most, majorise ? across : 0, across};
}

}  // namespace trocar::runtime
