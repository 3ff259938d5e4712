// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "runtime/deformation/local_solver.h"
#include "runtime/deformation/network.h"
#include "tests/bench/conditioning.h"
#include "tests/reference/deformation/global_solver.h"

namespace trocar::test {
namespace {

using nlohmann::json;
using runtime::Membrane;
using runtime::Network;
using runtime::NodeKind;

struct Sheet {
  const char* name;
  std::int32_t cell_x, cell_y;  ///< steps
  double jitter;                ///< displacement of inner vertices, in cells
  LatticePoint origin;
  double reach_cells;  ///< in the longer direction
  double tension_N_per_m;
  bool ring;  ///< its boundary is held
};

// 1e6 mm at 2^-8 mm a step.
constexpr std::int32_t kFar = 256'000'000;

const std::vector<Sheet>& sheets() {
  static const std::vector<Sheet> all{
      {"as usual", 512, 512, 0.12, {}, 8, 100, true},
      {"as usual, rim free", 512, 512, 0.12, {}, 8, 100, false},
      {"1e6 mm from the origin", 512, 512, 0.12, {kFar, -kFar}, 8, 100, true},
      {"triangles of one lattice step", 1, 1, 0, {}, 8, 100, true},
      {"tension 1e-6 N/m", 512, 512, 0.12, {}, 8, 1e-6, true},
      {"tension 1e8 N/m", 512, 512, 0.12, {}, 8, 1e8, true},
      {"needles of 0.05 degrees", 4, 4096, 0, {}, 8, 100, true},
      {"needles of 0.01 degrees", 1, 6000, 0, {}, 8, 100, true},
      {"reach of a hundredth of a triangle", 512, 512, 0.12, {}, 0.01, 100, true},
      {"reach of 1e3 triangles, rim free", 512, 512, 0.12, {}, 1e3, 100, false},
      {"reach of 1e5 triangles, rim free", 512, 512, 0.12, {}, 1e5, 100, false},
      {"reach of 1e5 triangles, rim held", 512, 512, 0.12, {}, 1e5, 100, true}};
  return all;
}

SliceMesh make_mesh(const Sheet& sheet, int side) {
  std::mt19937_64 bits(5);
  SliceMesh mesh;
  const auto jitter = [&](std::int32_t cell) {
    const double unit = static_cast<double>(bits() >> 11) * 0x1p-52 - 1;
    return static_cast<std::int32_t>(std::lrint(sheet.jitter * cell * unit));
  };
  for (int y = 0; y <= side; ++y) {
    for (int x = 0; x <= side; ++x) {
      LatticePoint p{sheet.origin.x + x * sheet.cell_x, sheet.origin.y + y * sheet.cell_y};
      if (x > 0 && x < side && y > 0 && y < side)
        p = {p.x + jitter(sheet.cell_x), p.y + jitter(sheet.cell_y)};
      mesh.vertices.push_back(p);
    }
  }
  const auto id = [side](int x, int y) { return static_cast<std::uint32_t>(y * (side + 1) + x); };
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
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
std::vector<NodeKind> make_kinds(int side, bool ring) {
  std::vector<NodeKind> kind;
  for (int y = 0; y <= side; ++y) {
    for (int x = 0; x <= side; ++x) {
      const bool rim = x == 0 || y == 0 || x == side || y == side;
      const bool tool =
          (x == side / 2 || x == side / 2 + 1) && (y == side / 2 || y == side / 2 + 1);
      kind.push_back(tool ? NodeKind::kTool : rim && ring ? NodeKind::kBorder : NodeKind::kFree);
    }
  }
  return kind;
}

/// The network computed from the lattice's integers, as a dense matrix: springs off the diagonal
/// (negated), the Winkler foundation apart from them.
struct PreciseNetwork {
  std::vector<std::vector<Precise>> spring;
  std::vector<Precise> bed;
};

PreciseNetwork make_precise(const SliceMesh& mesh, const Lattice& lattice, const Membrane& m) {
  const std::size_t n = mesh.vertices.size();
  PreciseNetwork out{{n, std::vector<Precise>(n, 0)}, std::vector<Precise>(n, 0)};
  const Precise step_m = Precise(lattice.step_mm()) / 1000;
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3], c = t[(k + 2) % 3];
      const auto x = [&](std::uint32_t i) { return Precise(mesh.vertices[i].x); };
      const auto y = [&](std::uint32_t i) { return Precise(mesh.vertices[i].y); };
      const Precise dot = (x(a) - x(c)) * (x(b) - x(c)) + (y(a) - y(c)) * (y(b) - y(c));
      const Precise area = (x(a) - x(c)) * (y(b) - y(c)) - (y(a) - y(c)) * (x(b) - x(c));
      const Precise half = Precise(m.tension_N_per_m) / 2 * dot / area;
      out.spring[a][b] += half;
      out.spring[b][a] += half;
      out.bed[a] += Precise(m.foundation_N_per_m3) * step_m * step_m * area / 6;
    }
  }
  return out;
}

struct PreciseSolution {
  std::vector<Precise> w;
  Precise stiffness = 0;
  /// max of |A^-1| |A| 1 (Skeel): the largest relative change of a displacement, relative to the
  /// largest one, per relative change of the matrix's numbers.
  double condition = 0;
  /// The sum of the tool's springs over their resulting force: the cancellation in that sum.
  double cancellation = 0;
};

PreciseSolution solve_precise(const PreciseNetwork& network, const std::vector<NodeKind>& kind) {
  const std::size_t all = kind.size();
  std::vector<std::size_t> free;
  for (std::size_t i = 0; i < all; ++i)
    if (kind[i] == NodeKind::kFree) free.push_back(i);
  const std::size_t n = free.size();
  std::vector<std::vector<Precise>> A(n, std::vector<Precise>(n));
  std::vector<Precise> w(n, 0), worst(n, 0);
  for (std::size_t r = 0; r < n; ++r) {
    Precise diagonal = network.bed[free[r]];
    for (std::size_t j = 0; j < all; ++j) {
      diagonal += network.spring[free[r]][j];
      if (kind[j] == NodeKind::kTool) w[r] += network.spring[free[r]][j];
    }
    for (std::size_t c = 0; c < n; ++c)
      A[r][c] = r == c ? diagonal : Precise(-network.spring[free[r]][free[c]]);
    for (const Precise& a : A[r])
      worst[r] += abs(a);
  }
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t r = k + 1; r < n; ++r) {
      if (A[r][k] == 0) continue;
      const Precise factor = A[r][k] / A[k][k];
      for (std::size_t c = k + 1; c < n; ++c)
        if (A[k][c] != 0) A[r][c] -= factor * A[k][c];
      w[r] -= factor * w[k];
      worst[r] -= factor * worst[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t c = k + 1; c < n; ++c) {
      w[k] -= A[k][c] * w[c];
      worst[k] -= A[k][c] * worst[c];
    }
    w[k] /= A[k][k];
    worst[k] /= A[k][k];
  }
  PreciseSolution out;
  out.w.assign(all, 0);
  for (std::size_t i = 0; i < all; ++i)
    if (kind[i] == NodeKind::kTool) out.w[i] = 1;
  for (std::size_t r = 0; r < n; ++r) {
    out.w[free[r]] = w[r];
    out.condition = std::max(out.condition, static_cast<double>(worst[r]));
  }
  Precise springs = 0;
  for (std::size_t i = 0; i < all; ++i) {
    if (kind[i] != NodeKind::kTool) continue;
    out.stiffness += network.bed[i];
    for (std::size_t j = 0; j < all; ++j) {
      out.stiffness += network.spring[i][j] * (1 - out.w[j]);
      springs += abs(network.spring[i][j]);
    }
  }
  out.cancellation = static_cast<double>(Precise(springs / out.stiffness));
  return out;
}

/// Largest error of a spring, relative to the stiffest spring of its node, and of the foundation.
double coefficient_error(const Network& network, const PreciseNetwork& precise) {
  double worst = 0;
  for (std::size_t i = 0; i < network.size(); ++i) {
    Precise largest = 0;
    for (const Precise& k : precise.spring[i])
      largest = std::max(largest, Precise(abs(k)));
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      const Precise error =
          abs(Precise(network.stiffness_N_per_m[k]) - precise.spring[i][network.neighbour[k]]);
      worst = std::max(worst, static_cast<double>(Precise(error / largest)));
    }
    worst = std::max(worst, static_cast<double>(Precise(
                                abs(Precise(network.foundation_N_per_m[i]) / precise.bed[i] - 1))));
  }
  return worst;
}

double displacement_error(const std::vector<double>& w, const PreciseSolution& exact) {
  Precise worst = 0;
  for (std::size_t i = 0; i < w.size(); ++i)
    worst = std::max(worst, Precise(abs(Precise(w[i]) - exact.w[i])));
  return static_cast<double>(worst);
}

}  // namespace

json network_rows(int side) {
  json rows = json::array();
  const Lattice lattice;
  for (const Sheet& sheet : sheets()) {
    const double reach_m =
        sheet.reach_cells * std::max(sheet.cell_x, sheet.cell_y) * lattice.step_m();
    const Membrane membrane{sheet.tension_N_per_m, sheet.tension_N_per_m / (reach_m * reach_m)};
    const SliceMesh mesh = make_mesh(sheet, side);
    const std::vector<NodeKind> kind = make_kinds(side, sheet.ring);
    const Network network = runtime::make_network(mesh, lattice, membrane);
    const PreciseNetwork precise = make_precise(mesh, lattice, membrane);
    const PreciseSolution exact = solve_precise(precise, kind);
    runtime::LocalSolution local;
    const bool solved = runtime::solve_local(network, kind, local, {.bounds = false});
    const auto global = runtime::solve_global(network, kind);
    json row = {{"id", sheet.name},
                {"inputs", sheet.name},
                {"count", std::count(kind.begin(), kind.end(), NodeKind::kFree)},
                {"condition", exact.condition},
                {"cancellation", exact.cancellation},
                {"coefficient_error", coefficient_error(network, precise)},
                {"coefficient_bound", 8 * kEpsilon},
                {"solved", solved && global}};
    if (solved && global) {
      const auto relative = [&](double stiffness) {
        return static_cast<double>(Precise(abs(Precise(stiffness) / exact.stiffness - 1)));
      };
      row["stiffness_error_local"] = relative(local.stiffness_N_per_m);
      row["stiffness_error_global"] = relative(global->stiffness_N_per_m);
      row["displacement_error_local"] = displacement_error(local.w, exact);
      row["displacement_error_global"] = displacement_error(global->w, exact);
      row["bound"] = 4 * kEpsilon * exact.condition;
      row["stiffness_bound"] = 4 * kEpsilon * exact.condition * (1 + exact.cancellation);
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace trocar::test
