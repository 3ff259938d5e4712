// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/bake/hu_field.h"

#include <Eigen/SparseCholesky>
#include <numeric>

#include "formats/mesh/regions.h"

namespace trocar::pipeline {
namespace {

using SparseMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, std::int32_t>;

// The lattice coordinates of the centres of an image's columns or rows, in ascending order.
class Centres {
 public:
  Centres(int offset, int count, double spacing_mm, const Lattice& lattice)
      : per_step_(lattice.step_mm() / spacing_mm), offset_(offset) {
    at_.reserve(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i)
      at_.push_back(lattice.snap_mm((i + offset) * spacing_mm));
  }
  int count() const { return static_cast<int>(at_.size()); }
  std::int64_t operator[](int i) const { return at_[static_cast<std::size_t>(i)]; }
  /// The first centre at or beyond the coordinate; count() if there is none.
  int first_from(std::int64_t c) const {
    const double guess = static_cast<double>(c) * per_step_ - offset_;
    int i = static_cast<int>(std::clamp(guess, 0.0, static_cast<double>(count())));
    while (i > 0 && (*this)[i - 1] >= c)
      --i;
    while (i < count() && (*this)[i] < c)
      ++i;
    return i;
  }

 private:
  std::vector<std::int32_t> at_;
  double per_step_;
  int offset_;
};

// Ceiling of n / d, d > 0.
std::int64_t ceil_div(std::int64_t n, std::int64_t d) {
  return n / d + (n % d > 0 ? 1 : 0);
}

// The smallest integer x with (x, y) on or to the right of the line through a and b; a.y != b.y.
std::int64_t first_right_of(LatticePoint a, LatticePoint b, std::int64_t y) {
  if (a.y > b.y) std::swap(a, b);
  return a.x + ceil_div((std::int64_t{b.x} - a.x) * (y - a.y), std::int64_t{b.y} - a.y);
}

// The barycentric coordinate of a corner along a row: at + per_pixel * (pixels from the first).
struct Barycentric {
  double at = 0, per_pixel = 0;
};
using Barycentrics = std::array<Barycentric, 3>;

// Barycentric coordinates of the true centres of pixels, which are not rounded to the lattice.
class PixelCoordinates {
 public:
  PixelCoordinates(const SliceMesh& mesh, const PixelGrid& grid)
      : mesh_(mesh),
        offset_x_(grid.offset_x),
        offset_y_(grid.offset_y),
        dx_(grid.spacing_u_mm / grid.lattice.step_mm()),
        dy_(grid.spacing_v_mm / grid.lattice.step_mm()) {}
  Barycentrics of(const PixelRow& row) const {
    const Triangle& t = mesh_.triangles[row.triangle];
    const LatticePoint a = mesh_.vertices[t[0]], b = mesh_.vertices[t[1]], c = mesh_.vertices[t[2]];
    const double x = (row.first_x + offset_x_) * dx_ - a.x, y = (row.y + offset_y_) * dy_ - a.y;
    const double bx = static_cast<double>(b.x) - a.x, by = static_cast<double>(b.y) - a.y;
    const double cx = static_cast<double>(c.x) - a.x, cy = static_cast<double>(c.y) - a.y;
    const double scale = 1 / static_cast<double>(orient2d(a, b, c));
    const Barycentric of_b{(x * cy - y * cx) * scale, dx_ * cy * scale};
    const Barycentric of_c{(y * bx - x * by) * scale, -dx_ * by * scale};
    return {Barycentric{1 - of_b.at - of_c.at, -of_b.per_pixel - of_c.per_pixel}, of_b, of_c};
  }

 private:
  const SliceMesh& mesh_;
  double offset_x_, offset_y_;
  double dx_, dy_;  // distances between pixels, in lattice steps
};

double bounded(float hu) {
  return std::clamp<double>(hu, kMinHu, kMaxHu);
}

double nearest_pixel(LatticePoint p, const Image& hu, const PixelGrid& grid) {
  const auto index = [&](std::int32_t c, double spacing_mm, int offset, int count) {
    const double i = std::rint(grid.lattice.to_mm(c) / spacing_mm) - offset;
    return static_cast<int>(std::clamp(i, 0.0, count - 1.0));
  };
  return bounded(hu.at(index(p.x, grid.spacing_u_mm, grid.offset_x, hu.width),
                       index(p.y, grid.spacing_v_mm, grid.offset_y, hu.height)));
}

// A matrix of zeros with the entries of the normal matrix's lower half: the diagonal and the edges.
SparseMatrix zeros_for(const SliceMesh& mesh) {
  const std::size_t n = mesh.vertices.size();
  const auto each_edge = [&mesh](auto take) {
    for (const Triangle& t : mesh.triangles) {
      for (std::size_t i = 0; i < 3; ++i)
        take(std::min(t[i], t[(i + 1) % 3]), std::max(t[i], t[(i + 1) % 3]));
    }
  };
  // The rows of each column in any order. An edge of two triangles is listed twice.
  std::vector<std::size_t> start(n + 1, 1);
  start[0] = 0;
  each_edge([&start](std::uint32_t column, std::uint32_t) { ++start[column + 1]; });
  std::partial_sum(start.begin(), start.end(), start.begin());
  std::vector<std::int32_t> rows(start[n]);
  std::vector<std::size_t> end(start.begin(), start.end() - 1);
  const auto put = [&rows, &end](std::uint32_t column, std::uint32_t row) {
    rows[end[column]++] = static_cast<std::int32_t>(row);
  };
  for (std::uint32_t v = 0; v < n; ++v)
    put(v, v);
  each_edge(put);
  // Sorts them and removes duplicates.
  const auto at = [&rows](std::size_t i) { return rows.begin() + static_cast<std::ptrdiff_t>(i); };
  std::size_t entries = 0;
  for (std::size_t v = 0; v < n; ++v) {
    std::sort(at(start[v]), at(end[v]));
    end[v] = static_cast<std::size_t>(std::unique(at(start[v]), at(end[v])) - rows.begin());
    entries += end[v] - start[v];
  }
  SparseMatrix out(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(n));
  out.resizeNonZeros(static_cast<Eigen::Index>(entries));
  std::fill_n(out.valuePtr(), entries, 0.0);
  std::int32_t* row = out.innerIndexPtr();
  for (std::size_t v = 0; v < n; ++v) {
    row = std::copy(at(start[v]), at(end[v]), row);
    out.outerIndexPtr()[v + 1] = static_cast<std::int32_t>(row - out.innerIndexPtr());
  }
  return out;
}

// The normal equations of the fit.
struct Normal {
  SparseMatrix matrix;  // lower half
  Eigen::VectorXd right;
  Eigen::VectorXd weights;  // by vertex: sum of its coordinates over the pixels
};

Normal normal_equations(const ComponentGroups::Group& group, const Image& hu, const PixelGrid& grid,
                        const std::vector<PixelRow>& rows, double smoothing) {
  const SliceMesh& mesh = group.mesh;
  const auto n = static_cast<std::int32_t>(mesh.vertices.size());
  Normal out{zeros_for(mesh), Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n)};
  const auto add = [&out](std::uint32_t a, std::uint32_t b, double value) {
    out.matrix.coeffRef(std::max(a, b), std::min(a, b)) += value;
  };
  std::vector<char> has_pixels(mesh.vertices.size(), 0);
  const PixelCoordinates all_shares(mesh, grid);
  auto row = rows.begin();
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    if (row != rows.end() && row->triangle == t) has_pixels[group.component[v[0]]] = 1;
    // Each triangle adds half of an edge's weight, so boundary edges count by half.
    std::array<std::array<double, 3>, 3> sums{};
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j <= i; ++j)
        sums[i][j] = (i == j ? 1 : -0.5) * smoothing;
    }
    for (; row != rows.end() && row->triangle == t; ++row) {
      double count = 0, x1 = 0, x2 = 0, hu0 = 0, hu1 = 0;
      for (int x = row->first_x; x < row->end_x; ++x) {
        const double value = bounded(hu.at(x, row->y)), at = x - row->first_x;
        count += 1, x1 += at, x2 += at * at;
        hu0 += value, hu1 += at * value;
      }
      const Barycentrics coordinates = all_shares.of(*row);
      for (std::size_t i = 0; i < 3; ++i) {
        const auto [p, q] = coordinates[i];
        out.right[v[i]] += p * hu0 + q * hu1;
        out.weights[v[i]] += p * count + q * x1;
        for (std::size_t j = 0; j <= i; ++j) {
          const auto [r, s] = coordinates[j];
          sums[i][j] += p * r * count + (p * s + q * r) * x1 + q * s * x2;
        }
      }
    }
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j <= i; ++j)
        add(v[i], v[j], sums[i][j]);
    }
  }
  // Components without pixels are treated as if they had one at each vertex.
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    if (has_pixels[group.component[v]] != 0) continue;
    add(v, v, 1);
    out.right[v] += nearest_pixel(mesh.vertices[v], hu, grid);
  }
  return out;
}

// Solves by sparse Cholesky factors. Eigen's minimum degree ordering gets the pattern alone, since
// SimplicialLDLT itself would order a copy of the whole symmetric matrix with its values.
Eigen::VectorXd solution(const Normal& normal) {
  using Pattern = Eigen::SparseMatrix<char, Eigen::ColMajor, std::int32_t>;
  using Ordering = Eigen::AMDOrdering<std::int32_t>;
  const SparseMatrix& a = normal.matrix;
  const std::vector<char> no_values(static_cast<std::size_t>(a.nonZeros()), 0);
  const Eigen::Map<const Pattern> pattern(a.rows(), a.cols(), a.nonZeros(), a.outerIndexPtr(),
                                          a.innerIndexPtr(), no_values.data());
  Ordering::PermutationType back;
  Ordering()(pattern.selfadjointView<Eigen::Lower>(), back);
  const Ordering::PermutationType there = back.inverse();
  SparseMatrix ordered(a.rows(), a.cols());
  ordered.selfadjointView<Eigen::Upper>() = a.selfadjointView<Eigen::Lower>().twistedBy(there);
  const Eigen::SimplicialLDLT<SparseMatrix, Eigen::Upper, Eigen::NaturalOrdering<std::int32_t>>
      factors(ordered);
  const Eigen::VectorXd right = there * normal.right;
  return back * factors.solve(right);
}

// Rounds each value to the nearest step. While the mean over the pixels is off, values that are
// nearly half-way between two steps are then rounded to the other one.
std::vector<float> rounded(const Eigen::VectorXd& fit, const Eigen::VectorXd& weights, int step) {
  constexpr double kEnough_steps = 1 / 32.0;
  const auto n = static_cast<std::size_t>(fit.size());
  std::vector<float> out(n);
  std::vector<double> up(n);
  double total = 0;
  for (std::size_t v = 0; v < n; ++v) {
    const auto at = static_cast<Eigen::Index>(v);
    const double value = std::clamp<double>(fit[at], kMinHu, kMaxHu);
    out[v] = static_cast<float>(step == 0 ? value : step * std::rint(value / step));
    up[v] = out[v] - value;
    total += weights[at] * up[v];
  }
  const double enough = kEnough_steps * step * weights.sum();
  if (step == 0 || std::abs(total) <= enough) return out;
  const double sign = total > 0 ? 1 : -1;
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return sign * up[a] > sign * up[b]; });
  for (const std::size_t v : order) {
    if (sign * up[v] <= 0 || sign * total <= enough) break;
    const double change = sign * step * weights[static_cast<Eigen::Index>(v)];
    if (std::abs(total - change) >= std::abs(total)) continue;
    out[v] -= static_cast<float>(sign * step);
    total -= change;
  }
  return out;
}

// Sets bias and error of the values over the pixels.
void measure(const SliceMesh& mesh, const Image& hu, const PixelGrid& grid,
             const std::vector<PixelRow>& rows, HuField& field) {
  double sum = 0, sum2 = 0;
  const PixelCoordinates all_shares(mesh, grid);
  for (const PixelRow& row : rows) {
    const Triangle& t = mesh.triangles[row.triangle];
    const Barycentrics coordinates = all_shares.of(row);
    double at = 0, per_pixel = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      at += coordinates[i].at * field.values[t[i]];
      per_pixel += coordinates[i].per_pixel * field.values[t[i]];
    }
    for (int x = row.first_x; x < row.end_x; ++x, at += per_pixel) {
      const double error = at - bounded(hu.at(x, row.y));
      sum += error, sum2 += error * error;
    }
    field.pixels += row.end_x - row.first_x;
  }
  if (field.pixels == 0) return;
  field.bias_hu = sum / static_cast<double>(field.pixels);
  field.rms_hu = std::sqrt(sum2 / static_cast<double>(field.pixels));
}

}  // namespace

std::vector<PixelRow> pixel_rows(const SliceMesh& mesh, const PixelGrid& grid, int width,
                                 int height) {
  const Centres columns(grid.offset_x, width, grid.spacing_u_mm, grid.lattice);
  const Centres rows(grid.offset_y, height, grid.spacing_v_mm, grid.lattice);
  std::vector<PixelRow> out;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    // Corner a is the lowest. At each y the triangle lies between ac and the chain a, b, c, on
    // either side.
    std::array<LatticePoint, 3> v{};
    for (std::size_t i = 0; i < 3; ++i)
      v[i] = mesh.vertices[mesh.triangles[t][i]];
    std::sort(v.begin(), v.end(), [](LatticePoint p, LatticePoint q) { return p.y < q.y; });
    const auto [a, b, c] = v;
    for (int y = rows.first_from(a.y); y < rows.count() && rows[y] < c.y; ++y) {
      const std::int64_t one = first_right_of(a, c, rows[y]);
      const std::int64_t other =
          rows[y] < b.y ? first_right_of(a, b, rows[y]) : first_right_of(b, c, rows[y]);
      const int first = columns.first_from(std::min(one, other));
      int end = first;
      while (end < columns.count() && columns[end] < std::max(one, other))
        ++end;
      if (first < end) out.push_back({t, y, first, end});
    }
  }
  return out;
}

HuField fit_hu_field(const SliceMesh& mesh, const Image& hu, const PixelGrid& grid,
                     const HuFieldOptions& options) {
  HuField out;
  if (mesh.vertices.empty()) return out;
  const auto n = static_cast<Eigen::Index>(mesh.vertices.size());
  Eigen::VectorXd fit(n), weights(n);
  std::vector<PixelRow> all_rows;
  ComponentGroups groups(mesh);
  for (std::size_t g = 0; g < groups.count(); ++g) {
    const ComponentGroups::Group& group = groups.group(g);
    const std::vector<PixelRow> rows = pixel_rows(group.mesh, grid, hu.width, hu.height);
    const Normal normal = normal_equations(group, hu, grid, rows, options.smoothing);
    const Eigen::VectorXd values = solution(normal);
    for (std::size_t i = 0; i < group.vertices.size(); ++i) {
      fit[group.vertices[i]] = values[static_cast<Eigen::Index>(i)];
      weights[group.vertices[i]] = normal.weights[static_cast<Eigen::Index>(i)];
    }
    for (const PixelRow& row : rows)
      all_rows.push_back({group.triangles[row.triangle], row.y, row.first_x, row.end_x});
  }
  out.values = rounded(fit, weights, options.step);
  measure(mesh, hu, grid, all_rows, out);
  return out;
}

}  // namespace trocar::pipeline
