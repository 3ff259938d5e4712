// SPDX-License-Identifier: Apache-2.0
// Sessions with punctures and faults allocate nothing on the haptic thread, and a tick makes no
// system call. The test links trocar_allocation_hooks; the first test shows that every allocation
// function is counted.
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstddef>
#include <cstdlib>
#include <functional>
#include <new>
#include <string>
#include <utility>

#include "runtime/realtime/realtime_thread.h"
#include "tests/runtime/session/test_session.h"
#include "tests/support/counted_allocations.h"
#include "tests/support/loop_rig.h"

namespace trocar::runtime {
namespace {

/// Keeps the compiler from removing an unused allocation.
void* volatile kept_block;

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
  void SetUp() override { TROCAR_NEEDS_COUNTED_ALLOCATIONS(); }
};

TEST_F(NoAllocation, EveryAllocationFunctionIsCounted) {
  const std::pair<std::uint64_t, std::function<void*()>> functions[] = {
      {2, [] { return std::malloc(10); }},
      {2, [] { return std::calloc(3, 7); }},
      {3, [] { return std::realloc(std::malloc(10), 5000); }},
      {2, [] { return std::aligned_alloc(64, 128); }},
      {2,
       [] {
         void* block = nullptr;
         EXPECT_EQ(::posix_memalign(&block, 64, 100), 0);
         return block;
       }},
      {0, [] { return static_cast<void*>(nullptr); }},
  };
  for (const auto& each : functions) {
    EXPECT_EQ(counted([&] {
                kept_block = each.second();
                std::free(kept_block);
              }),
              each.first);
  }
  EXPECT_EQ(counted([] {
              int* volatile one = new int(7);
              delete one;
            }),
            2U);
}

class Clocks : public NoAllocation, public testing::WithParamInterface<Clock> {};
INSTANTIATE_TEST_SUITE_P(NoAllocation, Clocks, testing::Values(Clock::kVirtual, Clock::kReal));

/// A session of the simulated device that records and allocates nothing in its loop.
SessionResult run_without_allocation(const Scene& scene, int slices, SessionOptions options) {
  testing_support::TestSession session(scene, slices);
  options.record = session.options.record;
  if (options.recovery == RecoveryPolicy::kAuto) options.black_box = session.folder.path();
  options.limits.gap_max_s = 0;
  session.options = options;
  SessionResult report = session.run();
  EXPECT_EQ(report.allocations_in_loop, std::optional<std::uint64_t>(0));
  return report;
}

TEST_P(Clocks, ASessionWithPuncturesDoesNotAllocate) {
  Scene scene = test::descent_scene({0.13, 0.12}, 0.133, 0.1, 0.06);
  // Down through both, up and down again beside the holes: contact, partial contact, four cuts.
  const double down_s = scene.hand.trajectory.back().t_s;
  scene.hand.trajectory.push_back({down_s + 0.3, {0, 0, 0.135}});
  scene.hand.trajectory.push_back({down_s + 0.5, {0.009, 0, 0.135}});
  scene.hand.trajectory.push_back({down_s + 1.0, {0.009, 0, 0.1}});
  scene.duration_s = down_s + 1.1;
  SessionOptions options;
  options.clock = GetParam();
  options.duration_s = scene.duration_s;
  const SessionResult report = run_without_allocation(scene, 2, options);
  EXPECT_EQ(report.fault, Fault::kNone) << to_string(report.fault);
  EXPECT_EQ(report.punctures.size(), 4U);
}

TEST_P(Clocks, FaultsRecoveriesAndBlackBoxesDoNotAllocate) {
  // Twice out of a low workspace and back, with the virtual coupling.
  Scene scene = test::descent_scene({0.13}, 0.133, 0.1, 0.06);
  scene.hand.trajectory = {{0, {0, 0, 0.133}, {}},   {0.2, {0, 0, 0.126}, {}},
                           {0.4, {0, 0, 0.145}, {}}, {0.6, {0, 0, 0.133}, {}},
                           {1.2, {0, 0, 0.133}, {}}, {1.3, {0, 0, 0.145}, {}},
                           {1.5, {0, 0, 0.133}, {}}};
  SessionOptions options;
  options.clock = GetParam();
  options.duration_s = 2;
  options.recovery = RecoveryPolicy::kAuto;
  options.coupling.on = true;
  options.limits.workspace_max_m[2] = 0.14;
  std::size_t received = 0;
  options.on_message = [&](const OperatorMessage&) { ++received; };
  const SessionResult report = run_without_allocation(scene, 1, options);
  EXPECT_EQ(report.faults_count, 2U);
  EXPECT_GE(received, 4U) << "two faults, two recoveries";
  EXPECT_EQ(report.end, SessionEnd::kDone);
  ASSERT_EQ(report.black_boxes.size(), 2U);
  EXPECT_FALSE(report.black_boxes[0].error);
}

/// Runs `act` in a child process that the kernel ends at any system call except exit; returns the
/// child's status.
int status_under_seccomp(const std::function<void()>& act) {
  const pid_t child = ::fork();
  if (child == 0) {
    sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_exit_group, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
    };
    const sock_fprog program{sizeof filter / sizeof filter[0], filter};
    if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
        ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0) {
      ::_exit(77);
    }
    act();
    ::_exit(0);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return status;
}

TEST_F(NoAllocation, ATickMakesNoSystemCall) {
  const int ended = status_under_seccomp([] { ::getppid(); });
  if (WIFEXITED(ended)) GTEST_SKIP() << "seccomp is not available";
  ASSERT_TRUE(WIFSIGNALED(ended) && WTERMSIG(ended) == SIGSYS) << "the filter stops a system call";
  test::RigOptions options;
  options.tissue.threshold_N = 35;
  options.pressed_N = 40;
  for (const bool faulty : {false, true}) {
    test::Rig rig(options);
    if (faulty) rig.model_.limits.workspace_min_m[2] = test::kRigSheet_m - 0.002;
    const int status = status_under_seccomp([&] {
      for (int i = 0; i < 800; ++i)
        rig.tick();  // contact, the controller, a puncture; or a fault and its ramp
      const bool expected = faulty ? rig.state_.safety.fault == Fault::kWorkspace
                                   : rig.law_.contact().tracks[0].state == SheetState::kPunctured;
      if (!expected) ::_exit(3);
    });
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
}

}  // namespace
}  // namespace trocar::runtime
