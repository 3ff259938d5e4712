// SPDX-License-Identifier: Apache-2.0
// Rounding errors of predicates, forces, Jacobian and torques, on random and on ill-conditioned
// inputs: compared with 50 digits or with integers of any length. A row has an "id", the number of
// inputs, the largest relative error, and the stated "bound" of it.
#pragma once

#include <boost/multiprecision/cpp_bin_float.hpp>
#include <limits>
#include <nlohmann/json.hpp>

namespace trocar::test {

/// Without expression templates, so that it can replace a double.
using Precise = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>,
                                              boost::multiprecision::et_off>;
inline constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

/// The lattice's predicates: wrong signs, and those of the same formulas in doubles.
nlohmann::json predicate_rows(int inputs);
/// Springs, and the equilibrium by both solvers, on square sheets of side x side cells; errors
/// against the network computed from the lattice's integers. O(side^6).
nlohmann::json network_rows(int side);
/// Both closed forms of the Jacobian, against differences in 50 digits of the inverse kinematics.
nlohmann::json jacobian_rows(int poses);
/// Torques, against the optimum enumerated in 50 digits.
nlohmann::json allocation_rows(int inputs);

}  // namespace trocar::test
