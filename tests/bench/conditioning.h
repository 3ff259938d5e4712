// SPDX-License-Identifier: Apache-2.0
// What rounding does to the numbers that decisions and forces rest on: each against the same
// numbers from 50 digits or from integers of any length, over random and hard inputs. Rows have an
// "id", how many inputs there were, the largest relative error, and the "bound" that is stated for
// it.
#pragma once

#include <boost/multiprecision/cpp_bin_float.hpp>
#include <limits>
#include <nlohmann/json.hpp>

namespace trocar::test {

/// Without expression templates, so that it can stand where a double does.
using Precise = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>,
                                              boost::multiprecision::et_off>;
inline constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

/// The lattice's predicates: wrong signs, and how many the same formulas get wrong in doubles.
nlohmann::json predicate_rows(int inputs);
/// Springs, and the equilibrium by both solvers, on square sheets of side x side cells; errors
/// against the network that the lattice's integers define. O(side^6).
nlohmann::json network_rows(int side);
/// Both closed forms of the Jacobian, against differences in 50 digits of the inverse kinematics.
nlohmann::json jacobian_rows(int poses);
/// Torques, against the optimum enumerated in 50 digits.
nlohmann::json allocation_rows(int inputs);

}  // namespace trocar::test
