// SPDX-License-Identifier: Apache-2.0
// A session with punctures makes no allocation on the haptic thread. The program has the counting
// hooks linked in; the first test shows that they count.
#include <gtest/gtest.h>

#include <cstdlib>
#include <new>
#include <string>
#include <thread>

#include "runtime/loop/allocation_counter.h"
#include "runtime/loop/session.h"
#include "tests/sheet_fixture.h"

namespace trocar::runtime {
namespace {

/// Keeps the compiler from leaving out an allocation that nobody uses.
void* volatile kept;

template <typename Act>
std::uint64_t counted(Act&& act) {
  const std::uint64_t before = allocations_in_scopes();
  {
    const NoAllocationScope scope;
    act();
  }
  return allocations_in_scopes() - before;
}

class NoAllocation : public testing::Test {
 protected:
  void SetUp() override {
    if (!allocations_are_counted()) GTEST_SKIP() << "this build has the sanitizer's allocator";
  }
};

TEST_F(NoAllocation, TheHooksCountEveryWay) {
  EXPECT_EQ(counted([] {}), 0U);
  EXPECT_EQ(counted([] {
              kept = std::malloc(10);
              std::free(kept);
            }),
            2U);
  EXPECT_EQ(counted([] {
              kept = std::calloc(3, 7);
              kept = std::realloc(kept, 5000);
              std::free(kept);
            }),
            3U);
  EXPECT_EQ(counted([] {
              kept = std::aligned_alloc(64, 128);
              std::free(kept);
            }),
            2U);
  EXPECT_EQ(counted([] {
              void* block = nullptr;
              ASSERT_EQ(::posix_memalign(&block, 64, 100), 0);
              kept = block;
              std::free(kept);
            }),
            2U);
  EXPECT_EQ(counted([] {
              int* volatile one = new int(7);
              delete one;
            }),
            2U);
  EXPECT_EQ(counted([] {
              std::vector<double> numbers(100);
              kept = numbers.data();
            }),
            2U);
  EXPECT_EQ(counted([] { std::free(nullptr); }), 0U);
}

TEST_F(NoAllocation, OnlyTheScopesThreadAndTimeCount) {
  const std::uint64_t before = allocations_in_scopes();
  kept = std::malloc(10);
  std::free(kept);
  {
    std::atomic<bool> go{false}, done{false};
    std::thread other([&] {
      while (!go) {
      }
      kept = std::malloc(10);
      std::free(kept);
      done = true;
    });
    {
      const NoAllocationScope scope;
      go = true;
      while (!done) {
      }
    }
    other.join();
  }
  EXPECT_EQ(allocations_in_scopes(), before);
}

class Clocks : public NoAllocation, public testing::WithParamInterface<Clock> {};
INSTANTIATE_TEST_SUITE_P(NoAllocation, Clocks, testing::Values(Clock::kVirtual, Clock::kReal));

TEST_P(Clocks, ASessionWithPuncturesMakesNone) {
  Scene scene = test::descent_scene({0.13, 0.12}, 0.133, 0.1, 0.06);
  // Down through both, up and down again beside the holes: contact, partial contact, four cuts.
  const double down_s = scene.hand.trajectory.back().t_s;
  scene.hand.trajectory.push_back({down_s + 0.3, {0, 0, 0.135}});
  scene.hand.trajectory.push_back({down_s + 0.5, {0.009, 0, 0.135}});
  scene.hand.trajectory.push_back({down_s + 1.0, {0.009, 0, 0.1}});
  scene.duration_s = down_s + 1.1;
  Remesher remesher(std::move(*place_slices(scene, test::square_asset(2), "a")));
  auto device = make_simulated_device(scene, default_device_description());
  ASSERT_TRUE(device);
  std::string file = (std::filesystem::temp_directory_path() / "trocar.XXXXXX").string();
  const std::filesystem::path folder = ::mkdtemp(file.data());
  SessionOptions options;
  options.clock = GetParam();
  options.duration_s = scene.duration_s;
  options.record = folder / "r.csv";
  options.limits.gap_max_s = 0;
  const auto report = run_session(
      scene, default_device_description(), remesher, *device,
      [&](double dt_s) { device->step(dt_s); }, options);
  std::filesystem::remove_all(folder);
  ASSERT_TRUE(report);
  EXPECT_EQ(report->fault, Fault::kNone) << to_word(report->fault);
  EXPECT_EQ(report->punctures.size(), 4U);
  ASSERT_TRUE(report->allocations_in_loop);
  EXPECT_EQ(*report->allocations_in_loop, 0U);
}

}  // namespace
}  // namespace trocar::runtime
