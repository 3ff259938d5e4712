// SPDX-License-Identifier: Apache-2.0
// Force Dimension's devices against the stand-in library (tests/stand_ins/force_dimension).
#include "runtime/device/pose/force_dimension.h"

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

using std::chrono::milliseconds;

/// One line of the stand-in's log.
struct Logged {
  std::string call;
  HandleWrench wrench{};
};

class ForceDimensionTest : public testing::Test {
 protected:
  void SetUp() override {
    set(kForceDimensionVariable, TROCAR_DHD_STAND_IN);
    set("TROCAR_DHD_LOG", (folder_ / "log.csv").string());
  }
  void TearDown() override {
    for (const char* const name : {kForceDimensionVariable, "TROCAR_DHD_LOG", "TROCAR_DHD_MODEL",
                                   "TROCAR_DHD_FAULT", "TROCAR_DHD_PATH", "TROCAR_DHD_SERIALS"}) {
      unset(name);
    }
  }
  static void set(const char* name, const std::string& value) {
    ::setenv(name, value.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
  }
  static void unset(const char* name) {
    ::unsetenv(name);  // NOLINT(concurrency-mt-unsafe)
  }
  void hold(const std::string& keyframe) {
    std::ofstream(folder_ / "path.json") << "[{\"t_s\": 0, " << keyframe << "}]";
    set("TROCAR_DHD_PATH", (folder_ / "path.json").string());
  }
  ForceDimensionOptions options() {
    ForceDimensionOptions options;
    options.say = [this](const std::string& line) { lines_.push_back(line); };
    return options;
  }
  /// The calls before the last close(): the stand-in writes its log when it is closed.
  std::vector<Logged> log() {
    std::vector<Logged> entries;
    std::ifstream stream(folder_ / "log.csv");
    std::string line;
    std::getline(stream, line);
    while (std::getline(stream, line)) {
      Logged entry;
      std::stringstream fields(line);
      std::string field;
      std::getline(fields, field, ',');
      std::getline(fields, entry.call, ',');
      for (double& value : entry.wrench) {
        std::getline(fields, field, ',');
        value = std::stod(field);
      }
      entries.push_back(entry);
    }
    return entries;
  }
  /// The wrenches that the device was told to render.
  std::vector<HandleWrench> rendered() {
    std::vector<HandleWrench> wrenches;
    for (const Logged& entry : log()) {
      if (entry.call.starts_with("set_force")) wrenches.push_back(entry.wrench);
    }
    return wrenches;
  }
  /// Expects that the log ends with zero wrench, forces off and the device closed.
  void expect_closed_without_force() {
    const std::vector<Logged> entries = log();
    ASSERT_GE(entries.size(), 3U);
    const auto* const last = &entries[entries.size() - 3];
    EXPECT_TRUE(last[0].call.starts_with("set_force")) << last[0].call;
    EXPECT_EQ(last[0].wrench, HandleWrench{});
    EXPECT_EQ(last[1].call, "disable_force");
    EXPECT_EQ(last[2].call, "close");
  }
  static void expect_line(const Error& error, const std::vector<std::string>& parts) {
    EXPECT_EQ(error.code, ExitCode::kDeviceFault);
    EXPECT_EQ(error.message.find('\n'), std::string::npos);
    EXPECT_TRUE(error.message.starts_with("forcedimension:")) << error.message;
    for (const std::string& part : parts) {
      EXPECT_NE(error.message.find(part), std::string::npos) << error.message << "\n" << part;
    }
  }
  void expect_open_fails(const std::vector<std::string>& parts) {
    ForceDimension device(options());
    const Result<void> opened = device.open();
    ASSERT_FALSE(opened);
    expect_line(opened.error(), parts);
    EXPECT_FALSE(device.exchange({}));
    EXPECT_TRUE(lines_.empty());
  }
  /// Exchanges until there is an error, for at most 10 s.
  static Result<PoseReading> exchange_until_error(ForceDimension& device) {
    for (int i = 0; i < 10'000; ++i) {
      Result<PoseReading> reading = device.exchange({1, 2, 3, 0, 0, 0});
      if (!reading) return reading;
      std::this_thread::sleep_for(milliseconds(1));
    }
    return PoseReading{};
  }

  test::TemporaryFolder folder_;
  std::vector<std::string> lines_;
};

TEST(ForceDimensionAddress, IsEmptyOrAnIndex) {
  EXPECT_EQ(*parse_force_dimension_address(""), -1);
  EXPECT_EQ(*parse_force_dimension_address("0"), 0);
  EXPECT_EQ(*parse_force_dimension_address("15"), 15);
  for (const char* const bad :
       {"16", "-1", "-0", "+1", "a", "1 ", " 1", "1:2", "99999999999", "\n"}) {
    const auto id = parse_force_dimension_address(bad);
    ASSERT_FALSE(id) << bad;
    EXPECT_EQ(id.error().code, ExitCode::kUsage);
    EXPECT_TRUE(id.error().message.starts_with("forcedimension:")) << id.error().message;
    EXPECT_EQ(id.error().message.find('\n'), std::string::npos);
  }
}

TEST_F(ForceDimensionTest, MissingLibrarySaysWhatToInstall) {
  unset(kForceDimensionVariable);
  if (::dlopen("libdhd.so.3", RTLD_LAZY) != nullptr ||
      ::dlopen("libdhd.so", RTLD_LAZY) != nullptr) {
    GTEST_SKIP() << "the real library is installed here";
  }
  expect_open_fails(
      {"forcedimension: ", "libdhd.so.3", "install the SDK", kForceDimensionVariable});
}

TEST_F(ForceDimensionTest, DeviceThatCannotDoWhatItsDescriptionSaysIsRefused) {
  const auto open = [&](bool wants_rotation, bool wants_moment) {
    ForceDimensionOptions wanted = options();
    wanted.wants_rotation = wants_rotation;
    wanted.wants_moment = wants_moment;
    wanted.needs_all = true;
    ForceDimension device(wanted);
    return device.open();
  };
  EXPECT_TRUE(open(false, false));
  const Result<void> turns = open(true, false), turned = open(false, true);
  ASSERT_FALSE(turns);
  expect_line(turns.error(), {"senses_rotation"});
  ASSERT_FALSE(turned);
  expect_line(turned.error(), {"moment_max_Nm"});
}

TEST_F(ForceDimensionTest, DeviceThatCannotBeUsedSaysWhy) {
  set("TROCAR_DHD_FAULT", "no_device@0");
  expect_open_fails({"no device is connected", "USB"});
  set("TROCAR_DHD_FAULT", "open_fails@0");
  expect_open_fails({"dhdOpen failed: the device is in use (-1)"});
  set(kForceDimensionVariable, TROCAR_DHD_INCOMPLETE);
  expect_open_fails({"no function dhdGetPosition;", "3.16"});
}

// Its positions would be wrong by an unknown distance, so it must get no force.
TEST_F(ForceDimensionTest, UncalibratedDeviceIsRefusedBeforeItsForcesAreEnabled) {
  set("TROCAR_DHD_FAULT", "uncalibrated@0");
  expect_open_fails({"the device is not calibrated", "rest position"});
  for (const Logged& entry : log()) {
    EXPECT_NE(entry.call, "enable_force");
    EXPECT_EQ(entry.wrench, HandleWrench{});
  }
  set("TROCAR_DHD_FAULT", "");
  EXPECT_TRUE(ForceDimension(options()).open());
}

TEST_F(ForceDimensionTest, IndexOfNoDeviceIsRefused) {
  ForceDimensionOptions second = options();
  second.id = 1;
  const Result<void> opened = ForceDimension(second).open();
  ASSERT_FALSE(opened);
  expect_line(opened.error(), {"forcedimension:1: there is no device 1; 1 connected"});
}

TEST_F(ForceDimensionTest, EachErrorCodeHasItsText) {
  std::string before;
  for (int code = 1; code <= 22; ++code) {
    set("TROCAR_DHD_FAULT", "error=" + std::to_string(code) + "@0");
    ForceDimension device(options());
    const Result<void> opened = device.open();
    ASSERT_FALSE(opened);
    expect_line(opened.error(), {" failed: "});
    EXPECT_NE(opened.error().message, before);
    before = opened.error().message;
  }
}

struct Model {
  const char* name;
  bool senses_rotation;
  bool renders_moment;
  const char* line;
};

class ForceDimensionModels : public ForceDimensionTest,
                             public testing::WithParamInterface<Model> {};

TEST_P(ForceDimensionModels, ExchangesForcesAndPoses) {
  const Model& model = GetParam();
  set("TROCAR_DHD_MODEL", model.name);
  hold(
      R"("position_m": [0.01, -0.02, 0.03], "rotation_vector_rad": [0.1, 0.2, -0.3], "buttons": 5)");
  ForceDimension device(options());
  const Result<void> opened = device.open();
  ASSERT_TRUE(opened) << opened.error().message;
  EXPECT_EQ(lines_, std::vector<std::string>{model.line});
  EXPECT_EQ(device.senses_rotation(), model.senses_rotation);
  EXPECT_EQ(device.renders_moment(), model.renders_moment);

  const Result<PoseReading> rest = device.exchange({});
  ASSERT_TRUE(rest) << rest.error().message;
  EXPECT_EQ(rest->buttons, 5U);
  const Eigen::Vector3d turn(0.1, 0.2, -0.3);
  const Eigen::Quaterniond q(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
  const std::array<double, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
  const std::array<double, 4> none{1, 0, 0, 0};
  const std::array<double, 3> position_m{0.01, -0.02, 0.03};
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR(rest->p_m[i], position_m[i], 1e-9);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(rest->q[i], (model.senses_rotation ? wxyz : none)[i], 1e-9);
  }

  std::mt19937 random(1);
  std::uniform_real_distribution<double> force(-8, 8);
  std::vector<HandleWrench> commanded{{}, {}};  // of open() and of the first exchange
  double t_s = rest->t_s;
  for (int i = 0; i < 50; ++i) {
    HandleWrench wrench{};
    for (double& value : wrench)
      value = force(random);
    const Result<PoseReading> reading = device.exchange(wrench);
    ASSERT_TRUE(reading) << reading.error().message;
    EXPECT_GT(reading->t_s, t_s);
    t_s = reading->t_s;
    if (!model.renders_moment) std::fill(wrench.begin() + 3, wrench.end(), 0);
    commanded.push_back(wrench);
  }
  device.close();
  commanded.emplace_back();  // of close()
  const std::vector<Logged> entries = log();
  ASSERT_GE(entries.size(), 2U);
  EXPECT_EQ(entries[0].call, "open");
  EXPECT_EQ(entries[1].call, "enable_force");
  EXPECT_EQ(rendered(), commanded);  // to the last bit
  expect_closed_without_force();
}

INSTANTIATE_TEST_SUITE_P(
    , ForceDimensionModels,
    testing::Values(Model{"omega.3", false, false,
                          "forcedimension: omega.3 found; its orientation is not measured; moments "
                          "are not rendered"},
                    Model{"omega.6", true, false,
                          "forcedimension: omega.6 found; moments are not rendered"},
                    Model{"sigma.7", true, true, "forcedimension: sigma.7 found"}),
    [](const auto& model) { return "model" + std::to_string(model.index); });

TEST_F(ForceDimensionTest, RotationAndMomentAreLeftOutIfNotWanted) {
  set("TROCAR_DHD_MODEL", "sigma.7");
  hold(R"("rotation_vector_rad": [0.1, 0.2, -0.3])");
  ForceDimensionOptions plain = options();
  plain.id = 0;
  plain.wants_rotation = plain.wants_moment = false;
  ForceDimension device(plain);
  ASSERT_TRUE(device.open());
  EXPECT_FALSE(device.senses_rotation() || device.renders_moment());
  const Result<PoseReading> reading = device.exchange({1, 2, 3, 4, 5, 6});
  ASSERT_TRUE(reading);
  EXPECT_EQ(reading->q, (std::array<double, 4>{1, 0, 0, 0}));
  device.close();
  EXPECT_EQ(rendered(), (std::vector<HandleWrench>{{}, {1, 2, 3, 0, 0, 0}, {}}));
}

TEST_F(ForceDimensionTest, AnyRotationBecomesItsQuaternion) {
  set("TROCAR_DHD_MODEL", "omega.6");
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Vector3d axis =
        i < 3 ? Eigen::Vector3d(Eigen::Vector3d::Unit(i))
              : Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
    const double angle = i % 2 == 0 ? 3.14159 : 0.07 * i;
    const Eigen::Vector3d turn = angle * axis;
    std::ostringstream keyframe;
    keyframe.precision(17);
    keyframe << "\"rotation_vector_rad\": [" << turn.x() << "," << turn.y() << "," << turn.z()
             << "]";
    hold(keyframe.str());
    set("TROCAR_DHD_LOG", (folder_ / ("log" + std::to_string(i))).string());
    ForceDimension device(options());
    ASSERT_TRUE(device.open());
    const Result<PoseReading> reading = device.exchange({});
    ASSERT_TRUE(reading) << reading.error().message;
    const auto& [w, x, y, z] = reading->q;
    const Eigen::Quaterniond expected(Eigen::AngleAxisd(angle, axis));
    EXPECT_NEAR(std::abs(expected.dot(Eigen::Quaterniond(w, x, y, z))), 1, 1e-9) << i;
  }
}

TEST_F(ForceDimensionTest, NoForceIsLeftByADestroyedConnection) {
  {
    ForceDimension device(options());
    ASSERT_TRUE(device.open());
    ASSERT_TRUE(device.exchange({1, 2, 3, 0, 0, 0}));
  }
  expect_closed_without_force();
}

TEST_F(ForceDimensionTest, FaultsOfAnExchangeAreSaidInOneLine) {
  set("TROCAR_DHD_MODEL", "sigma.7");
  for (const auto& [fault, part] : std::vector<std::pair<const char*, const char*>>{
           {"error=7@0.1", " failed: the command timed out (-1)"},
           {"disconnect@0.1", " failed: communication error (-1)"},
           {"read_error@0.1", "dhdGetPositionAndOrientationFrame failed: communication error (-1)"},
           {"nan@0.1", "dhdGetPositionAndOrientationFrame returned no usable position: 0.0"},
           {"skew@0.1", "dhdGetPositionAndOrientationFrame returned an orientation frame that"}}) {
    set("TROCAR_DHD_FAULT", fault);
    set("TROCAR_DHD_LOG", (folder_ / fault).string());
    ForceDimension device(options());
    const Result<void> opened = device.open();
    ASSERT_TRUE(opened) << opened.error().message;
    const Result<PoseReading> reading = exchange_until_error(device);
    ASSERT_FALSE(reading) << fault;
    expect_line(reading.error(), {part});
  }
}

TEST_F(ForceDimensionTest, CommandThatIsNotFiniteIsNotSent) {
  ForceDimension device(options());
  ASSERT_TRUE(device.open());
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    const Result<PoseReading> reading = device.exchange({0, 0, bad, 0, 0, 0});
    ASSERT_FALSE(reading);
    expect_line(reading.error(), {"not finite"});
  }
  device.close();
  EXPECT_EQ(rendered(), (std::vector<HandleWrench>{{}, {}}));  // of open() and of close()
}

TEST_F(ForceDimensionTest, AMeasurementThatIsGivenAgainHasItsTime) {
  set("TROCAR_DHD_FAULT", "same@0.1:0.5");
  ForceDimension device(options());
  ASSERT_TRUE(device.open());
  PoseReading last;
  int same = 0;
  bool is_new_again = false;
  for (int i = 0; i < 10'000 && !is_new_again; ++i) {
    const Result<PoseReading> reading = device.exchange({});
    ASSERT_TRUE(reading) << reading.error().message;
    EXPECT_GE(reading->t_s, last.t_s);
    if (reading->t_s == last.t_s) ++same;
    is_new_again = same > 0 && reading->t_s > last.t_s;
    last = *reading;
    std::this_thread::sleep_for(milliseconds(1));
  }
  EXPECT_GT(same, 0);
  EXPECT_TRUE(is_new_again);
}

TEST_F(ForceDimensionTest, OpensTheSameDeviceAgainAndNoOther) {
  for (const int index : {-1, 0}) {
    set("TROCAR_DHD_SERIALS", "7,8");
    ForceDimensionOptions chosen = options();
    chosen.id = index;
    ForceDimension device(chosen);
    ASSERT_TRUE(device.open());
    device.close();
    set("TROCAR_DHD_SERIALS", "8");  // the first one was disconnected
    const Result<void> other = device.open();
    ASSERT_FALSE(other);
    expect_line(other.error(), {"omega.3 with the serial number 7", "is not connected"});
    EXPECT_FALSE(device.exchange({}));
    for (const Logged& entry : log())
      EXPECT_NE(entry.call, "enable_force") << "of another device";
    set("TROCAR_DHD_SERIALS", "8,9,7");  // it is back, at another index
    const Result<void> again = device.open();
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_TRUE(device.exchange({0, 0, 1, 0, 0, 0}));
    device.close();
    expect_closed_without_force();
  }
}

}  // namespace
}  // namespace trocar::runtime
