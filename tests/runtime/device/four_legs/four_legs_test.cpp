// SPDX-License-Identifier: Apache-2.0
// The four-legged device as a hand device: what it renders against what was wanted, how a force ends, and its
// specification against the same quantities computed from the Jacobian.
#include "runtime/device/four_legs/four_legs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/device/symmetric_eigenvalues.h"
#include "tests/support/device_workspace.h"

namespace trocar::runtime {
namespace {

using testing_support::Random;
using testing_support::random_workspace_pose;

Pose middle() {
  Pose T;
  T.p_m.z() = 0.15;
  return T;
}

/// Encoders of a pose that a test sets, and the torques last written.
class Encoders final : public Device {
 public:
  DeviceStatus read(DeviceState& state) override {
    state = now;
    return DeviceStatus::kOk;
  }
  DeviceStatus write(const DeviceCommand& command) override {
    written = command.tau_motor_Nm;
    return on_write;
  }
  DeviceState now;
  DeviceStatus on_write = DeviceStatus::kOk;
  std::array<double, kMotors> written{};
};

class FourLegsTest : public testing::Test {
 protected:
  /// Moves the device to a pose, as in a tick. Returns the fault of find_pose().
  FaultDetail go_to(const Pose& T) {
    const InverseResult inverse = inverse_kinematics(description_, T);
    EXPECT_TRUE(inverse.status);
    encoders_.now.t_s += 1e-3;
    encoders_.now.encoder_rad = encoder_angles(inverse.joints);
    double t_s = 0;
    EXPECT_EQ(device_.read(t_s), DeviceStatus::kOk);
    EXPECT_EQ(t_s, encoders_.now.t_s);
    const FaultDetail found = device_.find_pose({false, 1e-3}, pose_);
    EXPECT_TRUE(device_.keep_reading());
    return found;
  }
  FaultDetail render(const Wrench& wanted) {
    RenderInput input;
    input.wanted = wanted;
    input.dt_s = 1e-3;
    input.compensation = compensation_;
    input.authority_rise = 1;
    return device_.render(input, scale_);
  }

  DeviceDescription description_ = default_device_description();
  Encoders encoders_;
  CompensationOptions compensation_;
  MechanismLimits limits_{.torque_rise_max_Nm_per_s = 1e9};
  FourLegs device_{description_, encoders_, limits_};
  PlatePose pose_;
  double scale_ = 0;
};

Wrench wrench_of(Random& random, double force_N) {
  Wrench wrench;
  for (int i = 0; i < 6; ++i)
    wrench[i] = (i < 3 ? force_N : 0.05 * force_N) * random.between(-1, 1);
  return wrench;
}

TEST_F(FourLegsTest, DeliversTheWantedWrenchTimesTheScaleWithinTheMotorsLimits) {
  Random random(3);
  int scaled = 0;
  for (int i = 0; i < 2000; ++i) {
    const Pose T = random_workspace_pose(random);
    ASSERT_EQ(go_to(T), Fault::kNone);
    EXPECT_LT((pose_.T_device_plate.p_m - T.p_m).norm(), 1e-9);
    const Wrench wanted = wrench_of(random, i % 2 == 0 ? 5 : 500);
    ASSERT_EQ(render(wanted), Fault::kNone);
    ASSERT_EQ(device_.write(), DeviceStatus::kOk);
    EXPECT_LT((device_.delivered() - scale_ * wanted).norm(), 1e-9 * (1 + wanted.norm()));
    for (const double tau : encoders_.written)
      ASSERT_LE(std::abs(tau), description_.motor_peak_torque_Nm);
    scaled += scale_ < 1;
  }
  EXPECT_GT(scaled, 200);
}

TEST_F(FourLegsTest, AForceThatEndsFadesFromTheLastCommandEvenIfWritingFailed) {
  ASSERT_EQ(go_to(middle()), Fault::kNone);
  Wrench wanted = Wrench::Zero();
  wanted[2] = 10;
  ASSERT_EQ(render(wanted), Fault::kNone);
  encoders_.on_write = DeviceStatus::kLinkLost;
  ASSERT_EQ(device_.write(), DeviceStatus::kLinkLost);
  const std::array<double, kMotors> attempted = encoders_.written;
  device_.stop();
  encoders_.on_write = DeviceStatus::kOk;
  for (const double share : {0.75, 0.5, 0.0}) {
    device_.fade(share);
    ASSERT_EQ(device_.write(), DeviceStatus::kOk);
    for (std::size_t i = 0; i < kMotors; ++i)
      EXPECT_EQ(encoders_.written.at(i), share * attempted.at(i));
  }
}

TEST_F(FourLegsTest, AWrenchThatIsNotFiniteIsAFaultAndChangesNoCommand) {
  ASSERT_EQ(go_to(middle()), Fault::kNone);
  Wrench wanted = Wrench::Ones();
  ASSERT_EQ(render(wanted), Fault::kNone);
  device_.write();
  const std::array<double, kMotors> before = encoders_.written;
  wanted[4] = std::numeric_limits<double>::quiet_NaN();
  const FaultDetail found = render(wanted);
  EXPECT_EQ(found.fault, Fault::kTorqueNotFinite);
  EXPECT_EQ(found.index, 4);
  device_.write();
  EXPECT_EQ(encoders_.written, before);
}

TEST_F(FourLegsTest, AReadingThatIsNotFiniteIsNotKept) {
  ASSERT_EQ(go_to(middle()), Fault::kNone);
  const Measurement good = device_.measured();
  encoders_.now.encoder_rad[3] = std::numeric_limits<double>::infinity();
  double t_s = 0;
  device_.read(t_s);
  EXPECT_EQ(device_.find_pose({true, 1e-3}, pose_), Fault::kEncoderNotFinite);
  EXPECT_FALSE(device_.keep_reading());
  device_.use_last_reading();
  EXPECT_EQ(device_.measured().value, good.value);
}

TEST(FourLegsSpecification, IsThatOfTheJacobian) {
  const DeviceDescription description = default_device_description();
  const FourLegsSpecification specification(description);
  Random random(9);
  for (int i = 0; i < 200; ++i) {
    const Pose T = random_workspace_pose(random);
    const Jacobian G = jacobian(description, T, inverse_kinematics(description, T).joints).G;
    const auto damping = specification.damping(T);
    ASSERT_TRUE(damping);
    Twist twist = wrench_of(random, 1);
    const double power_W =
        description.joint_viscous_friction_Nms_per_rad * (G * twist).squaredNorm();
    EXPECT_NEAR(twist.dot(*damping * twist), power_W, 1e-12 * (1 + power_W));
    // The largest share of a large wrench: by bisection, a little less fits the motors and a little more does not.
    const Wrench wanted = wrench_of(random, 1e4);
    const double share = specification.renderable_fraction(T, wanted);
    ASSERT_GT(share, 0);
    ASSERT_LT(share, 1);
    const double peak_Nm = description.motor_peak_torque_Nm;
    EXPECT_EQ(allocate_torques(G, 0.999 * share * wanted, peak_Nm).scale, 1);
    EXPECT_LT(allocate_torques(G, 1.001 * share * wanted, peak_Nm).scale, 1);
  }
  Pose far;
  far.p_m.z() = 2;
  EXPECT_FALSE(specification.damping(far));
  EXPECT_EQ(specification.renderable_fraction(far, Wrench::Ones()), 0);
  EXPECT_EQ(specification.describe_demand("threshold", far, Wrench::Ones()),
            "out of the device's reach");
}

// path_test.cpp compares the faults with those of the loop.
TEST(FourLegsSpecification, StatesTheMarginsOfAPose) {
  const DeviceDescription description = default_device_description();
  const FourLegsSpecification specification(description);
  Random random(5);
  for (int i = 0; i < 200; ++i) {
    const Pose T = random_workspace_pose(random);
    const JointAngles joints = inverse_kinematics(description, T).joints;
    const DeviceMargins margins = specification.margins(T);
    ASSERT_TRUE(margins.is_reachable);
    RecordingRow row;
    row.encoder_rad = encoder_angles(joints);
    // The joint at exactly its limit has the margin 0, and all others have more.
    const auto joint = static_cast<std::size_t>(margins.joint);
    const JointLimit& limit = description.joint_limit[joint % 4];
    const double at_rad = row.encoder_rad[joint];
    EXPECT_NEAR(std::min(at_rad - limit.min_rad, limit.max_rad - at_rad), margins.joint_rad, 1e-15);
    const Jacobian G = jacobian(description, T, joints).G;
    EXPECT_EQ(margins.inverse_condition,
              measure_singularity(description, T, joints, G).inverse_condition);
    const auto found = specification.pose_of(row);
    ASSERT_TRUE(found);
    EXPECT_LT(displacement(*found, T).norm(), 1e-9);
  }
  DeviceMargins margins;
  margins.joint_rad = -0.1;
  margins.joint = encoder_index(2, 3);
  margins.inverse_condition = 0.25;
  EXPECT_EQ(specification.describe_margins(margins),
            "theta4 of leg 3 5.7 deg beyond its limit; inverse condition at least 0.250");
  EXPECT_EQ(specification.describe_strength(), "6 Nm peak a motor");
  Pose far;
  far.p_m.z() = 2;
  EXPECT_FALSE(specification.margins(far).is_reachable);
  EXPECT_EQ(specification.margins(far).fault, Fault::kPoseResidual);
  EXPECT_EQ(specification.describe_fault(Fault::kPoseResidual, far),
            "theta1 of leg 1 is out of reach");
  EXPECT_EQ(specification.describe_fault(Fault::kPoseResidual, middle()), "");
  EXPECT_EQ(specification.describe_fault(Fault::kJointLimit, middle()), "");
  EXPECT_EQ(specification.describe_fault(Fault::kSingularity, middle()), "");
}

TEST(SymmetricEigenvalues, AreNoneForAMatrixThatIsNotFinite) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const double wrong : {std::numeric_limits<double>::quiet_NaN(), kInfinity, -kInfinity}) {
    for (int i = 0; i < 6; ++i) {
      for (int j = 0; j <= i; ++j) {
        Eigen::Matrix<double, 6, 6> symmetric = Eigen::Matrix<double, 6, 6>::Identity();
        symmetric(i, j) = wrong;
        EXPECT_FALSE(symmetric_eigenvalues(symmetric)) << wrong << " at " << i << ", " << j;
      }
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
