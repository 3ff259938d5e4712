// SPDX-License-Identifier: Apache-2.0
#include "formats/base/command_line.h"

#include <gtest/gtest.h>

#include <csignal>
#include <stdexcept>

namespace trocar {
namespace {

TEST(Program, ReportsAnExceptionAsABug) {
  EXPECT_EQ(run_program("program", [] { return 3; }), 3);
  testing::internal::CaptureStderr();
  EXPECT_EQ(run_program("program", []() -> int { throw std::runtime_error("broken"); }), 1);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "program: internal error: broken\n");
}

TEST(Program, SignalsRequestAStop) {
  stop_on_signals();
  EXPECT_FALSE(stop_requested);
  std::raise(SIGTERM);
  EXPECT_TRUE(stop_requested);
}

}  // namespace
}  // namespace trocar
