// SPDX-License-Identifier: Apache-2.0
// The stand-in for Force Dimension's library where force_dimension_test.cpp does not show it, and its simulated arm,
// which is also that of the Haply service, against exact solutions.
#include <dlfcn.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/stand_ins/faults.h"
#include "tests/stand_ins/simulated_arm.h"
#include "tests/support/temporary_folder.h"

namespace stand_in {
namespace {

const Eigen::Vector3d kNone = Eigen::Vector3d::Zero();
constexpr ArmSettings kArm;

TEST(SimulatedArm, AnswersAForceAsADampedSpring) {
  SimulatedArm arm({});
  const Eigen::Vector3d force(0, 0, 4);
  const double natural = std::sqrt(kArm.hand_stiffness_N_per_m / kArm.mass_kg);
  const double decay = kArm.hand_damping_N_s_per_m / (2 * kArm.mass_kg);
  const double damped = std::sqrt(natural * natural - decay * decay);
  const double end_m = force.z() / kArm.hand_stiffness_N_per_m;
  for (int i = 0; i < 41; ++i) {
    const double t_s = 0.0123 * i;
    arm.advance(t_s, force, kNone);
    const double swing = std::cos(damped * t_s) + decay / damped * std::sin(damped * t_s);
    EXPECT_NEAR(arm.position_m().z(), end_m * (1 - std::exp(-decay * t_s) * swing), 0.005 * end_m)
        << t_s;
  }
  EXPECT_EQ(arm.position_m().x(), 0);
}

TEST(SimulatedArm, TurnsByMomentOverStiffness) {
  SimulatedArm arm({{0, kNone, {0.2, 0, 0}}});
  const Eigen::Vector3d moment(0.3, 0, 0);
  for (int i = 0; i < 20; ++i)
    arm.advance(0.1 * i, kNone, moment);
  const Eigen::AngleAxisd turn(arm.orientation());
  EXPECT_NEAR(turn.angle(), 0.2 + 0.3 / kArm.hand_stiffness_Nm_per_rad, 1e-6);
  EXPECT_NEAR(turn.axis().x(), 1, 1e-9);
}

TEST(SimulatedArm, FollowsItsPathAndRestsAtTheEnd) {
  SimulatedArm arm({{0, {0.01, 0, 0}, kNone, 1}, {1, {0.11, 0, 0}, {0, 1, 0}, 2}});
  EXPECT_EQ(arm.position_m().x(), 0.01);
  double largest_m = 0;
  for (int i = 0; i < 20; ++i) {
    const double t_s = 0.05 * i;
    arm.advance(t_s, kNone, kNone);
    EXPECT_EQ(arm.buttons(), 1U);
    largest_m = std::max(largest_m, std::abs(arm.position_m().x() - (0.01 + 0.1 * t_s)));
  }
  EXPECT_GT(largest_m, 0);
  EXPECT_LT(largest_m, 0.003);  // a mass that is pulled along begins late
  for (int i = 2; i < 6; ++i)
    arm.advance(0.5 * i, kNone, kNone);
  EXPECT_NEAR(arm.position_m().x(), 0.11, 1e-9);
  EXPECT_NEAR(Eigen::AngleAxisd(arm.orientation()).angle(), 1, 1e-6);
  EXPECT_EQ(arm.buttons(), 2U);
}

TEST(SimulatedArm, OutlivesALongGap) {
  SimulatedArm arm({});
  arm.advance(1e6, {0, 0, 4}, kNone);
  EXPECT_NEAR(arm.position_m().z(), 4 / kArm.hand_stiffness_N_per_m, 1e-6);
}

TEST(Faults, AreParsed) {
  constexpr std::string_view kKinds[] = {"silence", "error"};
  const auto faults = parse_faults("silence@1.5,error=7@2:0.25", kKinds);
  ASSERT_EQ(faults.size(), 2U);
  EXPECT_EQ(faults[0].kind, "silence");
  EXPECT_EQ(faults[0].start_s, 1.5);
  EXPECT_FALSE(faults[0].duration_s);
  EXPECT_EQ(faults[1].code, 7);
  EXPECT_EQ(faults[1].duration_s, 0.25);
  for (const char* const bad : {"silence", "noise@1", "error@x", "error@-1", "error@1:0",
                                "silence=2@1", "error=x@1", "error@1 ,"}) {
    EXPECT_THROW(parse_faults(bad, kKinds), std::runtime_error) << bad;
  }
}

/// The library, loaded as a program loads the real one.
class StandIn : public testing::Test {
 protected:
  void SetUp() override {
    set("TROCAR_DHD_LOG", (folder_ / "log.csv").string());
    library_ = ::dlopen(TROCAR_DHD_STAND_IN, RTLD_NOW | RTLD_LOCAL);
    ASSERT_NE(library_, nullptr) << ::dlerror();  // NOLINT(concurrency-mt-unsafe)
  }
  void TearDown() override {
    for (const char* const name : {"TROCAR_DHD_LOG", "TROCAR_DHD_MODEL", "TROCAR_DHD_FAULT",
                                   "TROCAR_DHD_PATH", "TROCAR_DHD_SERIALS"}) {
      ::unsetenv(name);  // NOLINT(concurrency-mt-unsafe)
    }
  }
  static void set(const char* name, const std::string& value) {
    ::setenv(name, value.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
  }
  template <typename Signature>
  Signature* function(const char* name) {
    void* const found = ::dlsym(library_, name);
    EXPECT_NE(found, nullptr) << name;
    return reinterpret_cast<Signature*>(found);
  }
  char open() {
    const int id = function<int()>("dhdOpen")();
    EXPECT_GE(id, 0);
    return static_cast<char>(id);
  }
  int set_force(char id, double z_N) {
    return function<int(double, double, double, char)>("dhdSetForce")(0, 0, z_N, id);
  }
  int position(char id, Eigen::Vector3d& p) {
    return function<int(double*, double*, double*, char)>("dhdGetPosition")(&p.x(), &p.y(), &p.z(),
                                                                            id);
  }
  double z_m(char id) {
    Eigen::Vector3d p;
    EXPECT_EQ(position(id, p), 0);
    return p.z();
  }
  int last_error() { return function<int()>("dhdErrorGetLast")(); }
  /// Waits up to 10 s for `condition`.
  static bool becomes(const std::function<bool()>& condition) {
    for (int i = 0; i < 10'000; ++i) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return false;
  }

  trocar::test::TemporaryFolder folder_;
  void* library_ = nullptr;
};

TEST_F(StandIn, ForceActsOnlyWhileItIsEnabled) {
  const char id = open();
  EXPECT_EQ(set_force(id, 4), 0);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(z_m(id), 0);
  EXPECT_EQ(function<int(unsigned char, char)>("dhdEnableForce")(1, id), 0);
  EXPECT_TRUE(becomes([&] { return std::abs(z_m(id) - 4 / kArm.hand_stiffness_N_per_m) < 1e-6; }));
  EXPECT_EQ(function<int(unsigned char, char)>("dhdEnableForce")(0, id), 0);
  EXPECT_TRUE(becomes([&] { return std::abs(z_m(id)) < 1e-6; }));
  EXPECT_EQ(function<int(char)>("dhdClose")(id), 0);
  std::stringstream log;
  log << std::ifstream(folder_ / "log.csv").rdbuf();
  for (const char* const line :
       {"t_s,call,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm\n", ",open,0,", ",set_force,0,0,4,0,0,0\n",
        ",enable_force,0,0,4,", ",disable_force,", ",close,0,0,0,0,0,0\n"}) {
    EXPECT_NE(log.str().find(line), std::string::npos) << line << log.str();
  }
}

TEST_F(StandIn, AWrongIdIsAnErrorOfItsThread) {
  const char id = open();
  std::thread([&] {
    EXPECT_EQ(set_force(static_cast<char>(id + 1), 1), -1);
    EXPECT_EQ(last_error(), 15);
    EXPECT_STREQ(function<const char*()>("dhdErrorGetLastStr")(), "invalid device index");
  }).join();
  EXPECT_EQ(last_error(), 0);
  EXPECT_EQ(function<int(char)>("dhdOpenID")(1), -1);
  EXPECT_EQ(last_error(), 15);
  EXPECT_EQ(function<int(char)>("dhdClose")(id), 0);
  EXPECT_EQ(set_force(id, 0), -1);
}

TEST_F(StandIn, BadSettingsMakeOpenFail) {
  for (const auto& [name, value] : std::vector<std::pair<const char*, std::string>>{
           {"TROCAR_DHD_MODEL", "omega.4"},
           {"TROCAR_DHD_FAULT", "noise@1"},
           {"TROCAR_DHD_SERIALS", "1,x"},
           {"TROCAR_DHD_PATH", (folder_ / "none.json").string()},
           {"TROCAR_DHD_LOG", (folder_ / "none" / "log.csv").string()}}) {
    const char* const before = std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
    const std::string kept = before == nullptr ? "" : before;
    set(name, value);
    EXPECT_EQ(function<int()>("dhdOpen")(), -1) << name;
    EXPECT_EQ(last_error(), 14) << name;
    set(name, kept);
  }
  open();
}

}  // namespace
}  // namespace stand_in
