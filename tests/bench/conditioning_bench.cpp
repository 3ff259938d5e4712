// SPDX-License-Identifier: Apache-2.0
// conditioning_bench: rounding errors of spring network, Jacobian and torque allocation on usual and
// on ill-conditioned inputs, against 50 digits, beside their stated bounds: a failed bound is exit
// code 1. (The lattice's predicates are exact: tests/properties/properties_lattice_test.cpp.)
#include <algorithm>
#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>
#include <cmath>
#include <limits>
#include <optional>
#include <random>

#include <Eigen/Dense>

#include "runtime/device/four_legs/kinematics.h"
#include "runtime/device/four_legs/mechanism_limits.h"
#include "runtime/device/four_legs/torque_allocation.h"
#include "runtime/haptics/membrane/network.h"
#include "runtime/haptics/membrane/region.h"
#include "tests/bench/bench.h"
#include "tests/reference/decompositions/decompositions.h"
#include "tests/support/device_workspace.h"

namespace trocar::bench {
namespace {

using namespace trocar::runtime;
using testing_support::Random;
using testing_support::random_workspace_pose;

// Without expression templates, so that it can replace a double.
using Precise = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>,
                                              boost::multiprecision::et_off>;
template <int Rows, int Columns = 1>
using Exact = Eigen::Matrix<Precise, Rows, Columns>;
constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

double error_of(const Precise& value) {
  return static_cast<double>(Precise(abs(value)));
}

// ---- the spring network on square sheets, against the one computed from the lattice's integers ----

struct SheetKind {
  const char* name;
  std::int32_t cell_x, cell_y;  ///< steps
  double jitter;                ///< displacement of inner vertices, in cells
  LatticePoint origin;
  double reach_cells;  ///< in the longer direction
  double tension_N_per_m;
  bool ring;  ///< its boundary is held
};

constexpr std::int32_t kFar = 256'000'000;  // 1e6 mm
constexpr int kSide = 8;

const SheetKind kSheets[] = {
    {"usual", 512, 512, 0.12, {}, 8, 100, true},
    {"usual-rim-free", 512, 512, 0.12, {}, 8, 100, false},
    {"1e6-mm-from-the-origin", 512, 512, 0.12, {kFar, -kFar}, 8, 100, true},
    {"triangles-of-one-step", 1, 1, 0, {}, 8, 100, true},
    {"tension-1e-6", 512, 512, 0.12, {}, 8, 1e-6, true},
    {"tension-1e8", 512, 512, 0.12, {}, 8, 1e8, true},
    {"needles-of-0.05-deg", 4, 4096, 0, {}, 8, 100, true},
    {"needles-of-0.01-deg", 1, 6000, 0, {}, 8, 100, true},
    {"reach-of-a-hundredth-triangle", 512, 512, 0.12, {}, 0.01, 100, true},
    {"reach-of-1e3-triangles-rim-free", 512, 512, 0.12, {}, 1e3, 100, false},
    {"reach-of-1e5-triangles-rim-free", 512, 512, 0.12, {}, 1e5, 100, false},
    {"reach-of-1e5-triangles-rim-held", 512, 512, 0.12, {}, 1e5, 100, true}};

SliceMesh make_mesh(const SheetKind& sheet) {
  std::mt19937_64 bits(5);
  SliceMesh mesh;
  const auto jitter = [&](std::int32_t cell) {
    const double unit = static_cast<double>(bits() >> 11) * 0x1p-52 - 1;
    return static_cast<std::int32_t>(std::lrint(sheet.jitter * cell * unit));
  };
  for (int y = 0; y <= kSide; ++y) {
    for (int x = 0; x <= kSide; ++x) {
      LatticePoint p{sheet.origin.x + x * sheet.cell_x, sheet.origin.y + y * sheet.cell_y};
      if (x > 0 && x < kSide && y > 0 && y < kSide)
        p = {p.x + jitter(sheet.cell_x), p.y + jitter(sheet.cell_y)};
      mesh.vertices.push_back(p);
    }
  }
  const auto id = [](int x, int y) { return static_cast<std::uint32_t>(y * (kSide + 1) + x); };
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const std::uint32_t a = id(x, y), b = id(x + 1, y), c = id(x + 1, y + 1), d = id(x, y + 1);
      const std::vector<LatticePoint>& v = mesh.vertices;
      if (in_circle(v[a], v[b], v[c], v[d]) <= 0) {
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
      } else {
        mesh.triangles.push_back({a, b, d});
        mesh.triangles.push_back({b, c, d});
      }
    }
  }
  return mesh;
}

// Four nodes in the middle are the tool's; those on the boundary are the ring.
std::vector<NodeKind> make_kinds(bool ring) {
  std::vector<NodeKind> kind;
  for (int y = 0; y <= kSide; ++y) {
    for (int x = 0; x <= kSide; ++x) {
      const bool rim = x == 0 || y == 0 || x == kSide || y == kSide;
      const bool tool =
          (x == kSide / 2 || x == kSide / 2 + 1) && (y == kSide / 2 || y == kSide / 2 + 1);
      kind.push_back(tool ? NodeKind::kTool : rim && ring ? NodeKind::kBorder : NodeKind::kFree);
    }
  }
  return kind;
}

/// Springs and bed from the lattice's integers, with the equilibrium for the tool's depth 1.
struct ExactNetwork {
  Exact<-1, -1> spring;
  Exact<-1> bed, w;
  Precise stiffness = 0;
  double condition = 0;     ///< max of |A^-1| |A| 1 (Skeel)
  double cancellation = 0;  ///< the sum of the tool's springs over their resulting force
};

ExactNetwork exact_network(const SliceMesh& mesh, const std::vector<NodeKind>& kind,
                           const Lattice& lattice, const Membrane& m) {
  const auto n = std::ssize(mesh.vertices);
  ExactNetwork out{Exact<-1, -1>::Zero(n, n), Exact<-1>::Zero(n), Exact<-1>::Zero(n)};
  const Precise step_m = Precise(lattice.step_mm()) / 1000;
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
      const auto at = [&](std::uint32_t i) {
        return Exact<2>(Precise(mesh.vertices[i].x), Precise(mesh.vertices[i].y));
      };
      const Exact<2> p = at(a) - at(c), q = at(b) - at(c);
      const Precise area = p[0] * q[1] - p[1] * q[0];
      const Precise half = Precise(m.tension_N_per_m) / 2 * p.dot(q) / area;
      out.spring(a, b) += half;
      out.spring(b, a) += half;
      out.bed[a] += Precise(m.foundation_N_per_m3) * step_m * step_m * area / 6;
    }
  }
  std::vector<Eigen::Index> free;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (kind[static_cast<std::size_t>(i)] == NodeKind::kFree) free.push_back(i);
    if (kind[static_cast<std::size_t>(i)] == NodeKind::kTool) out.w[i] = 1;
  }
  const Exact<-1> diagonal = out.bed + out.spring.rowwise().sum();
  const Exact<-1, -1> all = Exact<-1, -1>(diagonal.asDiagonal()) - out.spring;
  const Exact<-1, -1> A = all(free, free);
  Exact<-1, 2> right(A.rows(), 2);
  const Exact<-1> loads = out.spring * out.w;
  right << loads(free), A.cwiseAbs().rowwise().sum();
  const Exact<-1, 2> solved = A.partialPivLu().solve(right);
  out.w(free) = solved.col(0);
  out.condition = static_cast<double>(solved.col(1).maxCoeff());
  Precise springs = 0;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (kind[static_cast<std::size_t>(i)] != NodeKind::kTool) continue;
    out.stiffness += out.bed[i] + out.spring.row(i).dot((Exact<-1>::Ones(n) - out.w).transpose());
    springs += out.spring.row(i).cwiseAbs().sum();
  }
  out.cancellation = static_cast<double>(Precise(springs / out.stiffness));
  return out;
}

/// Largest error of a spring, relative to the stiffest spring of its node, and of the bed.
double coefficient_error(const Network& network, const ExactNetwork& exact) {
  double worst = 0;
  for (std::size_t i = 0; i < network.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const Precise largest = exact.spring.row(row).cwiseAbs().maxCoeff();
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const Precise error = network.stiffness_N_per_m[k] - exact.spring(row, network.neighbour[k]);
      worst = std::max(worst, error_of(error / largest));
    }
    worst = std::max(worst, error_of(network.foundation_N_per_m[i] / exact.bed[row] - 1));
  }
  return worst;
}

void add_network(const SheetKind& sheet) {
  const Lattice lattice;
  const double reach_m =
      sheet.reach_cells * std::max(sheet.cell_x, sheet.cell_y) * lattice.step_m();
  const Membrane membrane{sheet.tension_N_per_m, sheet.tension_N_per_m / (reach_m * reach_m)};
  const SliceMesh mesh = make_mesh(sheet);
  const std::vector<NodeKind> kind = make_kinds(sheet.ring);
  const auto solve = [=] {
    LocalSolution local;
    if (!solve_local(make_network(mesh, lattice, membrane), kind, local, {.bounds = false}))
      throw std::runtime_error("not solved");
    return local;
  };
  const std::string name = "conditioning/network/" + std::string(sheet.name);
  add(name, benchmark::kMicrosecond, solve, [=] {
    const LocalSolution local = solve();
    const ExactNetwork exact = exact_network(mesh, kind, lattice, membrane);
    const double coefficients = coefficient_error(make_network(mesh, lattice, membrane), exact);
    double displacement = 0;
    for (std::size_t i = 0; i < local.w.size(); ++i)
      displacement =
          std::max(displacement, error_of(local.w[i] - exact.w[static_cast<Eigen::Index>(i)]));
    const double stiffness = error_of(local.stiffness_N_per_m / exact.stiffness - 1),
                 bound = 4 * kEpsilon * exact.condition,
                 stiffness_bound = bound * (1 + exact.cancellation);
    check(coefficients <= 8 * kEpsilon && displacement <= bound && stiffness <= stiffness_bound,
          name + ": an error is above its bound");
    check(std::string(sheet.name) != "usual" || std::max(stiffness, displacement) < 1e-14,
          name + ": not near rounding");
    return Counters{{"error_displacement", displacement},
                    {"bound_displacement", bound},
                    {"error_stiffness", stiffness},
                    {"bound_stiffness", stiffness_bound}};
  });
}

// ---- the Jacobian, against differences of the inverse kinematics in 50 digits ----

struct ExactPose {
  Exact<3> p;
  Exact<3, 3> R;
};

/// Shifted along an axis of {B} (0..2), or rotated about it through the plate's origin (3..5).
ExactPose moved(ExactPose T, int freedom, const Precise& by) {
  if (freedom < 3) {
    T.p[freedom] += by;
  } else {
    T.R = Eigen::AngleAxis<Precise>(by, Exact<3>::Unit(freedom - 3)).toRotationMatrix() * T.R;
  }
  return T;
}

/// The motor angles th1 and th4 of a leg.
Exact<2> motor_angles_of(const DeviceGeometry& g, const ExactPose& T, int leg) {
  static constexpr int kTurn[kLegs][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
  const int c = kTurn[leg][0], s = kTurn[leg][1];
  const Exact<3> joint = T.p + T.R * Exact<3>(g.R_T_m * c, g.R_T_m * s, 0);
  const Exact<3> C(c * joint[0] + s * joint[1], c * joint[1] - s * joint[0], joint[2]);
  const auto chain = [](const Precise& px, const Precise& py, const Precise& pn, const Precise& a,
                        const Precise& b, int branch) {
    const Precise span2 = px * px + py * py, reach2 = b * b - pn * pn;
    const Precise cosine = (span2 + a * a - reach2) / (2 * a * sqrt(span2));
    return Precise(atan2(py, px) + branch * acos(cosine));
  };
  const Precise th1 = chain(C[0] - g.R_B1_m, C[2] - g.z_A_m, C[1], g.l1_m, g.l2_m, g.branch_theta1);
  const Exact<3> E(g.R_B1_m + g.l1_m * cos(th1), 0, g.z_A_m + g.l1_m * sin(th1));
  const Exact<3> D = E + (Precise(g.l5_m) / g.l2_m) * (C - E);
  const Exact<3> B(g.R_B2_m * cos(Precise(g.d_rad)), g.R_B2_m * sin(Precise(g.d_rad)),
                   Precise(g.z_A_m) - g.H_B_m);
  const Exact<3> q = D - B;
  return Exact<2>(th1, chain(q[0], q[1], q[2], g.l3_m, g.l4_m, g.branch_theta4));
}

/// Central differences with a step that suits 50 digits; the worst error of a row of G, relative to
/// the row's largest entry.
double row_error(const DeviceGeometry& g, const Pose& pose, const Jacobian& G) {
  const Precise step("1e-17");
  const ExactPose T{pose.p_m.cast<Precise>(),
                    pose.q.cast<Precise>().normalized().toRotationMatrix()};
  Exact<kMotors, 6> exact;
  for (int freedom = 0; freedom < 6; ++freedom) {
    for (int leg = 0; leg < kLegs; ++leg) {
      const Exact<2> rate = (motor_angles_of(g, moved(T, freedom, step), leg) -
                             motor_angles_of(g, moved(T, freedom, -step), leg)) /
                            (2 * step);
      exact(motor_index(leg, 0), freedom) = rate[0];
      exact(motor_index(leg, 1), freedom) = rate[1];
    }
  }
  const Exact<kMotors, 6> error = G.cast<Precise>() - exact;
  double worst = 0;
  for (int i = 0; i < kMotors; ++i)
    worst = std::max(
        worst, error_of(error.row(i).cwiseAbs().maxCoeff() / exact.row(i).cwiseAbs().maxCoeff()));
  return worst;
}

const DeviceDescription& device() {
  static const DeviceDescription description = default_device_description();
  return description;
}

/// Distance to the nearest pose where two branches meet; negative where a leg does not reach.
double branch_distance(const Pose& T) {
  const InverseResult inverse = inverse_kinematics(device(), T);
  if (!inverse.status) return -1;
  const JacobianResult G = jacobian(device(), T, inverse.joints);
  if (!G.status) return -1;
  return measure_singularity(device(), T, inverse.joints, G.G).nearest_branch_m;
}

/// A pose within `distance_m` of the end of a branch, by bisection from the workspace outwards.
Pose beside_branch(Random& random, double distance_m) {
  const Pose from = random_workspace_pose(random);
  const Eigen::Vector3d along = random.direction();
  double low = 0, high = 0.4;
  for (int i = 0; i < 200 && high - low > 1e-17; ++i) {
    const double middle = (low + high) / 2;
    (branch_distance({from.p_m + middle * along, from.q}) > distance_m ? low : high) = middle;
  }
  return {from.p_m + low * along, from.q};
}

template <typename Make>
void add_jacobian(const std::string& kind, int count, const Make& make) {
  Random random(50);
  std::vector<Pose> poses;
  poses.reserve(static_cast<std::size_t>(count));
  for (int n = 0; n < count; ++n)
    poses.push_back(make(random));
  const std::string name = "conditioning/jacobian/" + kind;
  add(
      name, benchmark::kMicrosecond,
      [poses, next = std::size_t{0}]() mutable {
        const Pose& T = poses[next++ % poses.size()];
        const InverseResult inverse = inverse_kinematics(device(), T);
        benchmark::DoNotOptimize(jacobian(device(), T, inverse.joints));
      },
      [poses, name] {
        double error = 0, nearest_m = 1, refused = 0;
        for (const Pose& T : poses) {
          const InverseResult inverse = inverse_kinematics(device(), T);
          const JacobianResult G = jacobian(device(), T, inverse.joints);
          if (!inverse.status || !G.status) {
            ++refused;
            continue;
          }
          nearest_m = std::min(
              nearest_m, measure_singularity(device(), T, inverse.joints, G.G).nearest_branch_m);
          error = std::max(error, row_error(device().geometry, T, G.G));
        }
        const double bound = 8 * kEpsilon * (1 + device().geometry.l2_m / nearest_m);
        check(error <= bound, name + ": an error is above its bound");
        return Counters{{"error_row", error}, {"bound_row", bound}, {"refused", refused}};
      });
}

// ---- torque allocation, against the optimum that torque_allocation.h defines ----

constexpr double kRoundings = 64;  // rounding errors, times their largest amplification

struct Optimum {
  Exact<kMotors> c;        ///< minimum-norm torques of the wanted wrench
  Exact<kMotors, 2> null;  ///< an orthonormal basis of the torques without wrench
  Exact<kMotors> working, stiffness, tau;
  Precise scale = 1;

  Exact<kMotors> torques(const Exact<2>& y) const { return scale * c + null * y; }
  /// How far a torque is beyond its working limit.
  Exact<kMotors> excess(const Exact<kMotors>& t) const {
    return t - t.cwiseMin(working).cwiseMax(-working);
  }
  Precise cost(const Exact<2>& y) const {
    return y.squaredNorm() + excess(torques(y)).cwiseAbs2().dot(stiffness);
  }
};

/// The largest scale, at most 1, for which scale c + N y keeps the working limits: all vertices of a
/// linear programme of three unknowns.
Precise largest_scale(const Optimum& e) {
  Exact<2 * kMotors + 1, 3> rows;  // rows (scale, y) <= limits
  rows << e.c, e.null, -e.c, -e.null, Exact<1, 3>(1, 0, 0);
  Exact<2 * kMotors + 1> limits;
  limits << e.working, e.working, Precise(1);
  const Exact<2 * kMotors + 1> allowed = limits * (1 + Precise("1e-35"));
  Precise best = 0;
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    for (Eigen::Index j = i + 1; j < rows.rows(); ++j) {
      for (Eigen::Index k = j + 1; k < rows.rows(); ++k) {
        Exact<3, 3> A;
        A << rows.row(i), rows.row(j), rows.row(k);
        if (error_of(A.determinant()) < 1e-40) continue;
        const Exact<3> x = A.partialPivLu().solve(Exact<3>(limits[i], limits[j], limits[k]));
        if (x[0] > best && ((rows * x).array() <= allowed.array()).all()) best = x[0];
      }
    }
  }
  return best;
}

/// Law 5 of torque_allocation.h, by Newton's method with halved steps.
bool take_least_cost(Optimum& e) {
  Exact<2> y = Exact<2>::Zero();
  for (int iteration = 0; iteration < 200; ++iteration) {
    e.tau = e.torques(y);
    const Exact<kMotors> x = e.excess(e.tau);
    Exact<2, 2> H = Exact<2, 2>::Identity();
    Exact<2> slope = -y;
    for (int i = 0; i < kMotors; ++i) {
      if (x[i] == 0) continue;
      const Exact<2> row = e.null.row(i).transpose();
      H += e.stiffness[i] * row * row.transpose();
      slope -= e.stiffness[i] * x[i] * row;
    }
    if (slope.cwiseAbs().sum() < Precise("1e-32") * (1 + e.tau.squaredNorm())) return true;
    Exact<2> step = H.partialPivLu().solve(slope);
    const Precise here = e.cost(y);
    for (int halvings = 0; halvings < 100 && e.cost(y + step) >= here; ++halvings)
      step /= 2;
    y += step;
  }
  return false;
}

struct Task {
  Jacobian G;
  Wrench wanted;
  MotorVector limit;
};

std::optional<Optimum> optimum_of(const Task& task) {
  Optimum e;
  const Exact<kMotors, 6> G = task.G.cast<Precise>();
  const Exact<6, kMotors> pseudo = (G.transpose() * G).eval().partialPivLu().solve(G.transpose());
  e.c = pseudo.transpose() * task.wanted.cast<Precise>();
  // The null space: the projections of two motors' axes.
  const Exact<kMotors, kMotors> projector = Exact<kMotors, kMotors>::Identity() - G * pseudo;
  int found = 0;
  for (int motor = 0; motor < kMotors && found < 2; ++motor) {
    Exact<kMotors> axis = projector.col(motor);
    if (found == 1) axis -= e.null.col(0) * e.null.col(0).dot(axis);
    if (axis.norm() < 0.1) continue;
    e.null.col(found++) = axis / axis.norm();
  }
  const Exact<kMotors> limit = task.limit.cast<Precise>();
  const Precise reserve = kTorqueReserve;
  e.working = (1 - reserve) * limit;
  e.stiffness = (limit.squaredNorm() / (reserve * reserve)) * limit.cwiseAbs2().cwiseInverse();
  e.tau = e.c;
  if ((e.c.cwiseAbs().array() <= e.working.array()).all()) return e;
  if (found < 2) return std::nullopt;
  e.scale = largest_scale(e);
  return take_least_cost(e) ? std::optional(e) : std::nullopt;
}

/// Errors of one allocation, and their bounds (law 6): the largest change of the torques if every
/// number changes by a relative eps.
struct AllocationErrors {
  double torque = 0, scale = 0, wrench = 0, of_bound = 0;

  void add(const Task& task, const AllocationResult& got, const Optimum& exact) {
    const Exact<kMotors> tau = got.tau_motor_Nm.cast<Precise>();
    Exact<6> length = Exact<6>::Ones();
    length.tail<3>().setConstant(Precise(1) / kCharacteristicLength_m);
    const Exact<6> goal = Precise(got.scale) * task.wanted.cast<Precise>();
    const Exact<6> off = (task.G.cast<Precise>().transpose() * tau - goal).cwiseProduct(length);
    Jacobian scaled = task.G;
    scaled.rightCols<3>() /= kCharacteristicLength_m;
    const Eigen::VectorXd values = reference::singular_values(scaled);
    const double spread = task.limit.norm() / task.limit.minCoeff();
    const bool direct = got.kind == AllocationKind::kMinimumNorm;
    const double slope = direct ? 1 : (2 + 1.5 * spread / kTorqueReserve) * (1 + spread);
    const double unit = kRoundings * kEpsilon * values[0] / values[5];
    const auto note = [this](double error, double bound, double& worst) {
      worst = std::max(worst, error);
      of_bound = std::max(of_bound, error / bound);
    };
    note(error_of((tau - exact.tau).cwiseAbs().maxCoeff() / exact.tau.cwiseAbs().maxCoeff()),
         unit * slope, torque);
    note(error_of(got.scale / exact.scale - 1), unit * (direct ? 1 : spread), scale);
    note(error_of(off.cwiseAbs().maxCoeff() / goal.cwiseProduct(length).cwiseAbs().maxCoeff()),
         unit * (direct ? 1 : spread), wrench);
  }
};

template <typename Make>
void add_allocation(const std::string& kind, int count, const Make& make) {
  Random random(60);
  std::vector<Task> tasks;
  tasks.reserve(static_cast<std::size_t>(count));
  for (int n = 0; n < count; ++n)
    tasks.push_back(make(random));
  const auto allocate = [](const Task& t) { return allocate_torques(t.G, t.wanted, t.limit); };
  const std::string name = "conditioning/allocation/" + kind;
  add(
      name, benchmark::kMicrosecond,
      [tasks, allocate, next = std::size_t{0}]() mutable {
        benchmark::DoNotOptimize(allocate(tasks[next++ % tasks.size()]));
      },
      [tasks, allocate, name] {
        AllocationErrors errors;
        std::map<AllocationKind, double> kinds;
        for (const Task& task : tasks) {
          const AllocationResult got = allocate(task);
          const auto exact = optimum_of(task);
          check(exact && got.kind != AllocationKind::kRefused, name + ": no answer");
          if (!exact) continue;
          ++kinds[got.kind];
          errors.add(task, got, *exact);
        }
        check(errors.of_bound <= 1, name + ": an error is above its bound");
        return Counters{{"error_torque", errors.torque},
                        {"error_scale", errors.scale},
                        {"error_wrench", errors.wrench},
                        {"part_of_bound", errors.of_bound},
                        {"minimum_norm", kinds[AllocationKind::kMinimumNorm]},
                        {"null_space", kinds[AllocationKind::kNullSpace]},
                        {"scaled", kinds[AllocationKind::kScaled]}};
      });
}

Wrench wrench_of(Random& random, double force_N, double moment_Nm) {
  Wrench w;
  w << force_N * random.direction(), moment_Nm * random.in_ball();
  return w;
}
Jacobian jacobian_at(const Pose& T) {
  return jacobian(device(), T, inverse_kinematics(device(), T).joints).G;
}
Jacobian somewhere(Random& random) {
  return jacobian_at(random_workspace_pose(random));
}

/// A map that nearly cancels the plate's motion along one random direction.
Jacobian nearly_singular(Random& random, double relative) {
  Jacobian G = somewhere(random);
  const SingularRange range = singular_range(G);
  Wrench along = wrench_of(random, 1, 1);
  along.tail<3>() /= kCharacteristicLength_m;
  along.normalize();
  const MotorVector image = G * along;
  G -= (1 - relative * range.smallest / range.largest) * image * along.transpose();
  return G;
}

void add_all(const std::vector<Input>& /*inputs*/) {
  for (const SheetKind& sheet : kSheets)
    add_network(sheet);

  const int poses = quick ? 40 : 400;
  add_jacobian("stated-workspace", poses,
               [](Random& random) { return random_workspace_pose(random); });
  add_jacobian("wherever-the-legs-reach", poses, [](Random& random) {
    const testing_support::Workspace wide{
        .z_min_m = 0.05, .z_max_m = 0.24, .lateral_m = 0.08, .tilt_rad = 0.8};
    for (;;) {
      Pose T = random_workspace_pose(random, wide);
      if (branch_distance(T) > 0.002) return T;
    }
  });
  for (const auto& [kind, distance_m] : {std::pair{"1-mm-from-a-branch-end", 1e-3},
                                         {"1-um-from-a-branch-end", 1e-6},
                                         {"1-nm-from-a-branch-end", 1e-9}}) {
    add_jacobian(kind, poses / 4,
                 [d = distance_m](Random& random) { return beside_branch(random, d); });
  }

  const int tasks = quick ? 60 : 300;
  const MotorVector equal = MotorVector::Constant(6);
  add_allocation("within-the-limits", tasks, [&](Random& random) {
    return Task{somewhere(random), wrench_of(random, 35, 0.5), equal};
  });
  add_allocation("about-the-limits", tasks, [&](Random& random) {
    const double force_N = random.between(20, 200);
    return Task{somewhere(random), wrench_of(random, force_N, 2), equal};
  });
  // Upright in the middle, rows of the null space are parallel.
  add_allocation("upright-in-the-middle", tasks, [&](Random& random) {
    Pose T;
    T.p_m.z() = random.between(0.095, 0.205);
    return Task{jacobian_at(T), wrench_of(random, random.between(20, 200), 2), equal};
  });
  add_allocation("limits-from-1e-3-to-1e3-Nm", tasks, [&](Random& random) {
    MotorVector limit;
    for (int i = 0; i < kMotors; ++i)
      limit[i] = std::pow(10, random.between(-3, 3));
    return Task{somewhere(random), wrench_of(random, random.between(1, 100), 1), limit};
  });
  for (const auto& [kind, force_N] : {std::pair{"1e-6-N", 1e-6}, {"1e9-N", 1e9}}) {
    add_allocation(kind, tasks / 4, [&, f = force_N](Random& random) {
      return Task{somewhere(random), wrench_of(random, f, f / 100), equal};
    });
  }
  for (const auto& [kind, relative] : {std::pair{"nearly-singular-1e-2", 1e-2},
                                       {"nearly-singular-1e-4", 1e-4},
                                       {"nearly-singular-1e-6", 1e-6}}) {
    add_allocation(kind, tasks, [&, r = relative](Random& random) {
      const Jacobian G = nearly_singular(random, r);
      return Task{G, wrench_of(random, 35, 0.5), equal};
    });
  }
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
