// SPDX-License-Identifier: Apache-2.0
// What the options of trocar-run set.
#include "runtime/program/run_arguments.h"

#include <gtest/gtest.h>

namespace trocar::runtime {
namespace {

TEST(RunArguments, ACouplingIsDampedInProportionToItsStiffness) {
  const CouplingOptions usual;
  for (const double factor : {0.01, 0.1, 1.0, 10.0}) {
    RunArguments arguments;
    arguments.coupling_N_per_m = factor * usual.stiffness_N_per_m;
    SessionOptions options;
    set_loop_options(arguments, options);
    EXPECT_TRUE(options.coupling.on);
    EXPECT_EQ(options.coupling.stiffness_N_per_m, *arguments.coupling_N_per_m);
    EXPECT_DOUBLE_EQ(options.coupling.damping_N_s_per_m, factor * usual.damping_N_s_per_m);
  }
  SessionOptions options;
  set_loop_options({}, options);
  EXPECT_FALSE(options.coupling.on);
}

}  // namespace
}  // namespace trocar::runtime
