// SPDX-License-Identifier: Apache-2.0
// The contract of PoseHand and PoseFrame.
#include "runtime/device/pose/pose_hand.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace trocar::runtime {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class StatedDevice final : public PoseDevice {
 public:
  PoseReading next;
  DeviceStatus status = DeviceStatus::kOk;
  HandleWrench written{};
  std::uint8_t byte = 0;
  FaultDetail refused;
  std::uint8_t fault_byte() const noexcept override { return byte; }
  FaultDetail refused_contents() const noexcept override { return refused; }
  DeviceStatus read(PoseReading& reading) noexcept override {
    if (status == DeviceStatus::kOk) reading = next;
    return status;
  }
  DeviceStatus write(const HandleWrench& wrench) noexcept override {
    written = wrench;
    return DeviceStatus::kOk;
  }
};

PoseDeviceDescription arm(double moment_max_Nm = 0, bool senses_rotation = true) {
  PoseDeviceDescription device;
  device.force_max_N = 5;
  device.moment_max_Nm = moment_max_Nm;
  device.senses_rotation = senses_rotation;
  device.mass_kg = 0.3;
  device.position_resolution_m = device.rotation_resolution_rad = 0;
  device.workspace_min_m = {-0.1, -0.2, 0};
  device.workspace_max_m = {0.1, 0, 0.2};
  device.turn_rad = {0, 0, std::numbers::pi / 2};
  return device;
}

const Pose kStart{{0.01, 0.02, 0.15}, from_rotation_vector({0.1, 0, 0})};

class PoseHandTest : public testing::Test {
 protected:
  FaultDetail see(const PoseReading& reading, double step_s = 1e-3) {
    encoder_.next = reading;
    double t_s = 0;
    EXPECT_EQ(hand_->read(t_s), DeviceStatus::kOk);
    const FaultDetail found = hand_->find_pose({has_last_, step_s}, pose_);
    has_last_ = hand_->keep_reading() || has_last_;
    return found;
  }
  void use(const PoseDeviceDescription& device) {
    device_ = device;
    hand_.emplace(device_, PoseFrame(device_, kStart), encoder_);
    has_last_ = false;
  }
  Wrench rendered(const Wrench& wanted, double& scale) {
    RenderInput input;
    input.wanted = wanted;
    EXPECT_EQ(hand_->render(input, scale), Fault::kNone);
    EXPECT_EQ(hand_->write(), DeviceStatus::kOk);
    return hand_->delivered();
  }

  PoseDeviceDescription device_;
  StatedDevice encoder_;
  std::optional<PoseHand> hand_;
  PlatePose pose_;
  bool has_last_ = false;
};

TEST_F(PoseHandTest, MiddleOfTheWorkspaceIsThePlatesMiddle) {
  use(arm());
  PoseReading middle;
  middle.p_m = {0, -0.1, 0.1};
  EXPECT_EQ(see(middle), Fault::kNone);
  EXPECT_NEAR((pose_.T_device_plate.p_m - kStart.p_m).norm(), 0, 1e-15);
  EXPECT_NEAR(pose_.T_device_plate.q.angularDistance(kStart.q), 0, 1e-12);
  // The device's x axis is the scene's y axis: it is turned by 90 degrees about z.
  middle.p_m[0] += 0.003;
  EXPECT_EQ(see(middle), Fault::kNone);
  EXPECT_NEAR((pose_.T_device_plate.p_m - kStart.p_m - Eigen::Vector3d(0, 0.003, 0)).norm(), 0,
              1e-15);
}

TEST_F(PoseHandTest, RotationAboutAnAxisOfTheDeviceIsOneAboutThatAxisInTheScene) {
  use(arm());
  PoseReading turned;
  turned.p_m = {0, -0.1, 0.1};
  turned.q = {std::cos(0.1), std::sin(0.1), 0,
              0};  // by 0.2 rad about the device's x, the scene's y
  EXPECT_EQ(see(turned), Fault::kNone);
  const Eigen::Quaterniond expected = from_rotation_vector({0, 0.2, 0}) * kStart.q;
  EXPECT_NEAR(pose_.T_device_plate.q.angularDistance(expected), 0, 1e-12);
}

TEST_F(PoseHandTest, WithoutASenseOfRotationTheToolKeepsItsOrientation) {
  use(arm(0, false));
  PoseReading reading;
  reading.p_m = {0, -0.1, 0.1};
  reading.q = {kNan, 7, 0, 0};  // is ignored
  EXPECT_EQ(see(reading), Fault::kNone);
  EXPECT_EQ(pose_.T_device_plate.q.coeffs(), kStart.q.coeffs());
  EXPECT_EQ(hand_->measured().count, 3);
}

TEST_F(PoseHandTest, FrameAndItsInverseAgree) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  const PoseFrame frame(arm(), kStart);
  for (int i = 0; i < 100; ++i) {
    PoseReading reading;
    Eigen::Quaterniond q(any(random), any(random), any(random), any(random));
    q.normalize();
    reading.p_m = {any(random), any(random), any(random)};
    reading.q = {q.w(), q.x(), q.y(), q.z()};
    const PoseReading back = frame.reading(frame.plate(reading));
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_NEAR(back.p_m[k], reading.p_m[k], 1e-14);
    EXPECT_NEAR(std::abs(Eigen::Quaterniond(back.q[0], back.q[1], back.q[2], back.q[3]).dot(q)), 1,
                1e-12);
    Wrench wrench;
    for (int k = 0; k < 6; ++k)
      wrench[k] = any(random);
    EXPECT_NEAR((frame.from_device(frame.to_device(wrench)) - wrench).norm(), 0, 1e-14);
    // Power is the same in both frames: moving the handle by dp moves the plate by the turned dp.
    const HandleWrench turned = frame.to_device(wrench);
    PoseReading moved = reading;
    moved.p_m[0] += 1e-3;
    const Eigen::Vector3d step_m = frame.plate(moved).p_m - frame.plate(reading).p_m;
    EXPECT_NEAR(wrench.head<3>().dot(step_m), turned[0] * 1e-3, 1e-12);
  }
}

TEST_F(PoseHandTest, WhatIsNoNumberIsAFaultWithItsAxis) {
  use(arm());
  PoseReading reading;
  reading.p_m = {0, kNan, 0};
  FaultDetail found = see(reading);
  EXPECT_EQ(found.fault, Fault::kRefusedState);
  EXPECT_EQ(found.quantity, FaultQuantity::kMeasuredPosition);
  EXPECT_EQ(found.index, 1);
  reading.p_m = {0, 0, std::numeric_limits<double>::infinity()};
  EXPECT_EQ(see(reading), Fault::kRefusedState);
  reading.p_m = {};
  for (const double w : {kNan, 0.0, 0.9, 1.1}) {
    reading.q = {w, 0, 0, 0};
    found = see(reading);
    EXPECT_EQ(found.fault, Fault::kRefusedState) << w;
    EXPECT_EQ(found.quantity, FaultQuantity::kMeasuredRotation);
  }
}

// A device that states mm: 3 mm would be 3 m away.
TEST_F(PoseHandTest, AnotherUnitIsToldFromAPlaceOutsideTheWorkspace) {
  use(arm());
  PoseReading reading;
  for (const double at : {3.0, -2.01, 120.0, -1e300}) {
    reading.p_m = {0, 0, at};
    const FaultDetail found = see(reading);
    EXPECT_EQ(found.fault, Fault::kRefusedState) << at;
    EXPECT_EQ(found.quantity, FaultQuantity::kMeasuredPosition);
    EXPECT_EQ(found.index, 2);
    EXPECT_EQ(found.limit, std::copysign(kFarthest_m, at));
  }
  use(arm());
  reading.p_m = {0, 0, 1.9};
  EXPECT_EQ(see(reading), Fault::kNone) << "check_own_workspace() says more";
  EXPECT_EQ(hand_->check_own_workspace(), Fault::kWorkspace);
  PoseDeviceDescription large = arm();
  large.workspace_max_m[2] = 4;
  use(large);
  reading.p_m = {0, 0, 3.5};
  EXPECT_EQ(see(reading), Fault::kNone);
}

TEST_F(PoseHandTest, StepThatNoHandMakesIsAFault) {
  use(arm());
  PoseReading reading;
  EXPECT_EQ(see(reading), Fault::kNone);
  reading.p_m[2] = 0.0049;
  EXPECT_EQ(see(reading), Fault::kNone);
  reading.p_m[2] += 0.0051;
  FaultDetail found = see(reading);
  EXPECT_EQ(found.fault, Fault::kEncoderJump);
  EXPECT_EQ(found.quantity, FaultQuantity::kPositionStep);
  EXPECT_NEAR(found.value, 0.0051, 1e-12);
  // The step is within what a hand does in 2 ms.
  reading.p_m[2] += 0.0051;
  EXPECT_EQ(see(reading, 2e-3), Fault::kNone);
  reading.q = {std::cos(0.05), 0, std::sin(0.05), 0};
  found = see(reading);
  EXPECT_EQ(found.fault, Fault::kEncoderJump);
  EXPECT_EQ(found.quantity, FaultQuantity::kRotationStep);
  EXPECT_NEAR(found.value, 0.1, 1e-12);
  // The negative quaternion is the same orientation.
  reading.q = {-std::cos(0.05), 0, -std::sin(0.05), 0};
  EXPECT_EQ(see(reading), Fault::kNone);
}

TEST_F(PoseHandTest, ForceIsLimitedInItsDirectionAndTheMomentDropped) {
  use(arm());
  Wrench wanted;
  wanted << 6, 0, 8, 0.3, 0.1, 0;
  double scale = 0;
  const Wrench delivered = rendered(wanted, scale);
  EXPECT_DOUBLE_EQ(scale, 0.5);
  EXPECT_NEAR((delivered.head<3>() - Eigen::Vector3d(3, 0, 4)).norm(), 0, 1e-12);
  EXPECT_EQ(delivered.tail<3>().norm(), 0);
  // In the device's frame: the scene's x is the device's -y.
  EXPECT_NEAR(encoder_.written[0], 0, 1e-12);
  EXPECT_NEAR(encoder_.written[1], -3, 1e-12);
  EXPECT_NEAR(encoder_.written[2], 4, 1e-12);
}

TEST_F(PoseHandTest, DeviceThatRendersMomentsGetsForceAndMomentInOneScale) {
  use(arm(0.1));
  Wrench wanted;
  wanted << 0, 0, 4, 0.2, 0, 0;
  double scale = 0;
  const Wrench delivered = rendered(wanted, scale);
  EXPECT_DOUBLE_EQ(scale, 0.5);
  EXPECT_NEAR((delivered - 0.5 * wanted).norm(), 0, 1e-12);
}

TEST_F(PoseHandTest, WrenchThatIsNoNumberIsAFaultAndChangesNoCommand) {
  use(arm());
  double scale = 1;
  rendered(Wrench::Unit(2) * 3, scale);
  for (int i = 0; i < 6; ++i) {
    RenderInput input;
    input.wanted[i] = kNan;
    const FaultDetail found = hand_->render(input, scale);
    EXPECT_EQ(found.fault, Fault::kTorqueNotFinite);
    EXPECT_EQ(found.index, i);
    hand_->stop();
    hand_->fade(0.5);
    hand_->write();
    EXPECT_NEAR(hand_->delivered()[2], 1.5, 1e-12);
    hand_->fade(0);
    hand_->write();
    EXPECT_EQ(hand_->delivered().norm(), 0);
    rendered(Wrench::Unit(2) * 3, scale);
  }
}

TEST_F(PoseHandTest, RandomWrenchesNeverExceedTheDevice) {
  use(arm(0.1));
  std::mt19937_64 random(5);
  std::normal_distribution<double> any(0, 1);
  for (int i = 0; i < 10'000; ++i) {
    Wrench wanted;
    for (int k = 0; k < 6; ++k)
      wanted[k] = std::pow(10, 6 * any(random)) * any(random);
    double scale = 0;
    rendered(wanted, scale);
    const HandleWrench& f = encoder_.written;
    EXPECT_LE(std::hypot(f[0], f[1], f[2]), 5 * (1 + 1e-12));
    EXPECT_LE(std::hypot(f[3], f[4], f[5]), 0.1 * (1 + 1e-12));
    EXPECT_GE(scale, 0);
    EXPECT_LE(scale, 1);
  }
}

TEST_F(PoseHandTest, ReadingsAreAsStatedOrAssumed) {
  PoseDeviceDescription device = arm();
  device.position_resolution_m.reset();
  device.rotation_resolution_rad.reset();
  device.position_noise_m = 2e-6;
  device.delay_s = 1e-3;
  const auto readings = [&] {
    return PoseSpecification(device, PoseFrame(device, kStart)).readings();
  };
  EXPECT_TRUE(readings().is_assumed);
  EXPECT_EQ(readings().resolution_m, 50e-6);
  EXPECT_EQ(readings().noise_m, 2e-6);
  EXPECT_EQ(readings().delay_s, 1e-3);
  device.position_resolution_m = 0;
  EXPECT_FALSE(readings().is_assumed) << "of positions; that of the rotation is missing";
  EXPECT_EQ(readings().resolution_rad, 1e-3);
  device.rotation_resolution_rad = 2e-3;
  EXPECT_FALSE(readings().is_assumed);
  EXPECT_EQ(readings().resolution_m, 0) << "exact, as stated";
  EXPECT_EQ(readings().resolution_rad, 2e-3);
  device.senses_rotation = false;
  device.rotation_resolution_rad.reset();
  EXPECT_FALSE(readings().is_assumed);
}

TEST_F(PoseHandTest, AQuaternionThatChangesItsSignIsMeasuredAsAtRest) {
  PoseDeviceDescription device = arm();
  use(device);
  PoseReading reading;
  reading.p_m = {0, -0.1, 0.1};
  reading.q = {-0.6, 0, 0.8, 0};
  EXPECT_EQ(see(reading), Fault::kNone);
  const Measurement first = hand_->measured();
  EXPECT_NEAR(first.value[3], -0.6, 1e-9) << "the sign of the first one";
  for (int i = 0; i < 3; ++i) {
    for (double& value : reading.q)
      value = -value;
    EXPECT_EQ(see(reading), Fault::kNone);
    EXPECT_EQ(hand_->measured().value, first.value) << i;
    RecordingRow row;
    DeviceReadout readout;
    hand_->describe(row, readout);
    EXPECT_EQ(row.pose_device.q, reading.q) << "as it was stated";
  }
}

TEST_F(PoseHandTest, TheBoxIsThatOfTheDeviceAlsoIfItIsTurned) {
  PoseDeviceDescription device = arm();
  device.workspace_min_m = {-0.1, -0.1, -0.1};
  device.workspace_max_m = {0.1, 0.1, 0.1};
  device.turn_rad = {0, 0, std::numbers::pi / 4};
  use(device);
  const DeviceSpecification& specification = hand_->specification();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      PoseReading reading;
      reading.p_m[axis] = 0.1 * side;
      has_last_ = false;
      EXPECT_EQ(see(reading), Fault::kNone);
      EXPECT_EQ(hand_->check_own_workspace(), Fault::kNone);
      EXPECT_NEAR(specification.margins(pose_.T_device_plate).box_m, 0, 1e-8);
      EXPECT_GE(specification.margins(pose_.T_device_plate).box_m, 0);
      EXPECT_EQ(specification.describe_fault(Fault::kWorkspace, pose_.T_device_plate), "");
      reading.p_m[axis] = 0.13 * side;
      has_last_ = false;
      EXPECT_EQ(see(reading), Fault::kNone) << "it still gives a pose";
      const FaultDetail found = hand_->check_own_workspace();
      EXPECT_EQ(found.fault, Fault::kWorkspace);
      EXPECT_EQ(found.quantity, FaultQuantity::kMeasuredPosition);
      EXPECT_EQ(found.index, static_cast<int>(axis));
      EXPECT_EQ(found.value, 0.13 * side);
      EXPECT_EQ(found.limit, 0.1 * side);
      EXPECT_NEAR(specification.margins(pose_.T_device_plate).box_m, -0.03, 1e-8);
      const std::string text =
          specification.describe_fault(Fault::kWorkspace, pose_.T_device_plate);
      EXPECT_EQ(text, std::string("the handle is at ") + "xyz"[axis] +
                          (side < 0 ? " -0.1300" : " 0.1300") +
                          " m in the device's frame; its box is -0.1000 to 0.1000 m");
    }
  }
}

TEST_F(PoseHandTest, AFaultOfTheDeviceIsStatedWithItsByteAndRefusedStatesAreNamed) {
  use(arm());
  EXPECT_EQ(hand_->fault_of(DeviceStatus::kEmergencyStop), Fault::kEmergencyStop);
  EXPECT_EQ(hand_->fault_of(DeviceStatus::kMotorFault).quantity, FaultQuantity::kNone);
  EXPECT_EQ(hand_->fault_of(DeviceStatus::kLinkLost).quantity, FaultQuantity::kNone);
  encoder_.byte = 4;
  encoder_.refused = {Fault::kRefusedState, FaultQuantity::kMeasuredPosition, 1, kNan, 10};
  const FaultDetail reported = hand_->fault_of(DeviceStatus::kMotorFault);
  EXPECT_EQ(reported.fault, Fault::kMotorFault);
  EXPECT_EQ(measured(reported), "fault byte of the device: 4");
  for (const FaultDetail& refused :
       {hand_->fault_of(DeviceStatus::kLinkLost), hand_->refused_contents()}) {
    EXPECT_EQ(refused.fault, Fault::kRefusedState);
    EXPECT_EQ(refused.quantity, FaultQuantity::kMeasuredPosition);
    EXPECT_EQ(refused.index, 1);
  }
  EXPECT_EQ(hand_->fault_of(DeviceStatus::kEmergencyStop).quantity, FaultQuantity::kNone);
}

TEST_F(PoseHandTest, RowHasWhatWasMeasuredAndCommanded) {
  use(arm());
  PoseReading reading;
  reading.t_s = 2.5;
  reading.p_m = {0.01, -0.1, 0.1};
  reading.buttons = 5;
  EXPECT_EQ(see(reading), Fault::kNone);
  double scale = 0;
  rendered(Wrench::Unit(2) * 2, scale);
  RecordingRow row;
  DeviceReadout readout;
  hand_->describe(row, readout);
  EXPECT_EQ(row.pose_device.p_m, reading.p_m);
  EXPECT_EQ(row.pose_device.q, reading.q);
  EXPECT_EQ(row.pose_device.buttons, 5U);
  EXPECT_EQ(row.pose_device.wrench, encoder_.written);
  EXPECT_EQ(row.state_t_s, 2.5);
  EXPECT_NEAR(readout.margin, 0.09, 1e-12);
}

TEST_F(PoseHandTest, WorkspaceIsTheTurnedBoxAroundTheStart) {
  PoseDeviceDescription device = arm();
  device.workspace_max_m[0] = 0.3;
  const PoseFrame::Box box = PoseFrame(device, kStart).workspace();
  // The device's x, 0.4 m long, lies along the scene's y.
  EXPECT_NEAR((box.max_m - box.min_m - Eigen::Vector3d(0.2, 0.4, 0.2)).norm(), 0, 1e-12);
  EXPECT_NEAR(((box.max_m + box.min_m) / 2 - kStart.p_m).norm(), 0, 1e-12);
}

}  // namespace
}  // namespace trocar::runtime
