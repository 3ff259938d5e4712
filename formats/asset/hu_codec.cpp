// SPDX-License-Identifier: Apache-2.0
#include "formats/asset/hu_codec.h"

#include <zlib.h>
#include <Eigen/Cholesky>
#include <limits>
#include <numbers>

namespace trocar {
namespace {

constexpr float kNoHu = std::numeric_limits<float>::quiet_NaN();

std::array<Eigen::Vector2d, 19> make_points() {
  std::array<Eigen::Vector2d, 19> points;
  points[0].setZero();
  std::size_t n = 1;
  for (int ring = 1; ring <= 2; ++ring) {
    const int count = 6 * ring;
    const double inner = 3.0 * ring * (ring - 1) + 1, outer = inner + count;
    const double radius =
        2.0 / 3 * (std::pow(outer, 1.5) - std::pow(inner, 1.5)) / (outer - inner) / std::sqrt(19.0);
    for (int k = 0; k < count; ++k) {
      const double angle = 2 * std::numbers::pi * k / count;
      points[n++] = radius * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    }
  }
  return points;
}

constexpr int kNeighbours = 6;      // of the predictor
constexpr int kWeightBits = 6;      // its weights are in units of 2^-6
constexpr std::size_t kBorder = 2;  // samples around the box that the predictor reads
using Weights = std::array<std::int8_t, kNeighbours>;

// The lattice coordinates of the grid's columns or rows, ascending.
class GridAxis {
 public:
  GridAxis(double origin_mm, double pitch_mm, int count, const Lattice& lattice)
      : origin_(origin_mm / lattice.step_mm()), per_step_(lattice.step_mm() / pitch_mm) {
    at_.reserve(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i)
      at_.push_back(lattice.snap_mm(origin_mm + i * pitch_mm));
  }
  std::int32_t operator[](int i) const { return at_[static_cast<std::size_t>(i)]; }
  int count() const { return static_cast<int>(at_.size()); }
  /// The first one at or above a coordinate; count() if there is none.
  int first_from(double coordinate) const {
    // They are a lattice step apart at least and within half a step of equal distances, so that the
    // estimate is off by few.
    const double estimate = std::clamp((coordinate - origin_) * per_step_, 0.0, 1.0 * count());
    int i = static_cast<int>(estimate);
    while (i > 0 && (*this)[i - 1] >= coordinate)
      --i;
    while (i < count() && (*this)[i] < coordinate)
      ++i;
    return i;
  }

 private:
  double origin_, per_step_;
  std::vector<std::int32_t> at_;
};

// The columns or rows between two lattice coordinates, both included.
struct CodeRange {
  int first = 0, end = 0;
};
CodeRange between(const GridAxis& axis, double low, double high) {
  const int first = axis.first_from(low);
  int end = std::max(first, axis.first_from(high));
  while (end < axis.count() && axis[end] <= high)
    ++end;
  return {first, end};
}

bool is_near_edge(LatticePoint p, LatticePoint a, LatticePoint b, std::int64_t margin2) {
  const std::int64_t abx = std::int64_t{b.x} - a.x, aby = std::int64_t{b.y} - a.y;
  const std::int64_t along = (std::int64_t{p.x} - a.x) * abx + (std::int64_t{p.y} - a.y) * aby;
  const std::int64_t length2 = abx * abx + aby * aby;
  if (along <= 0) return distance2(a, p) <= margin2;
  if (along >= length2) return distance2(b, p) <= margin2;
  const Int128 across = orient2d(a, b, p);
  return across * across <= Int128{margin2} * length2;
}

class MaskMaker {
 public:
  MaskMaker(const HuGrid& grid, const Lattice& lattice)
      : margin_(grid.margin_steps),
        x_(grid.origin_mm.x(), grid.pitch_mm.x(), grid.columns, lattice),
        y_(grid.origin_mm.y(), grid.pitch_mm.y(), grid.rows, lattice) {}

  Result<HuMask> make(Outlines outlines) {
    std::int64_t edges = 0;
    std::optional<LatticeBox> box;
    for (const Pslg* outline : outlines) {
      for (const Ring& ring : outline->rings) {
        if (ring.empty()) continue;
        if (!box) box = {ring[0], ring[0]};
        widen(*box, ring);
        edges += static_cast<std::int64_t>(ring.size());
      }
    }
    if (!box) return HuMask{};
    const CodeRange columns = between(x_, static_cast<double>(box->low.x) - margin_,
                                      static_cast<double>(box->high.x) + margin_),
                    rows = between(y_, static_cast<double>(box->low.y) - margin_,
                                   static_cast<double>(box->high.y) + margin_);
    mask_ = {columns.first, rows.first, columns.end - columns.first, rows.end - rows.first, {}};
    const std::int64_t samples = std::int64_t{mask_.columns} * mask_.rows;
    if (samples > kMaxHuSamples) return refused("more samples of HU than a slice may have");
    mask_.is_stored.assign(static_cast<std::size_t>(samples), 0);
    // An edge of a sample's length comes near to at most some dozens of samples, and not many edges that
    // do not cross lie within a margin of one sample.
    left_ = 1024 * edges + 1024 * samples;
    fill_inside(outlines);
    each_edge(outlines, [this](LatticePoint a, LatticePoint b) { mark_near(a, b); });
    if (left_ <= 0) return refused("its outlines are too dense for its HU");
    return std::move(mask_);
  }

 private:
  char& stored(int column, int row) {
    return mask_.is_stored[static_cast<std::size_t>(row - mask_.first_row) *
                               static_cast<std::size_t>(mask_.columns) +
                           static_cast<std::size_t>(column - mask_.first_column)];
  }

  // Calls visit(from, to) for the edges of the outlines, as long as there may be more work.
  template <typename Visit>
  void each_edge(Outlines outlines, const Visit& visit) const {
    for (const Pslg* outline : outlines) {
      for (const Ring& ring : outline->rings) {
        for (std::size_t i = 0; i < ring.size() && left_ > 0; ++i)
          visit(ring[i], ring[(i + 1) % ring.size()]);
      }
    }
  }

  // Marks the samples inside: a row enters and leaves the material where edges cross it.
  void fill_inside(Outlines outlines) {
    std::vector<std::vector<double>> crossings(static_cast<std::size_t>(mask_.rows));
    each_edge(outlines, [&](LatticePoint a, LatticePoint b) {
      if (a.y > b.y) std::swap(a, b);
      // Rows with a.y <= y < b.y, so that a vertex on a row counts once.
      CodeRange rows = between(y_, a.y, static_cast<double>(b.y) - 1);
      for (int r = rows.first; r < rows.end; ++r) {
        const double share = (static_cast<double>(y_[r]) - a.y) / (static_cast<double>(b.y) - a.y);
        crossings[static_cast<std::size_t>(r - mask_.first_row)].push_back(
            a.x + share * (static_cast<double>(b.x) - a.x));
        --left_;
      }
    });
    for (int r = mask_.first_row; r < mask_.first_row + mask_.rows; ++r) {
      // Samples so near to a crossing that rounding matters are within the margin anyway.
      std::vector<double>& at = crossings[static_cast<std::size_t>(r - mask_.first_row)];
      std::sort(at.begin(), at.end());
      for (std::size_t i = 0; i + 1 < at.size(); i += 2) {
        const CodeRange columns = between(x_, at[i], at[i + 1]);
        for (int c = columns.first; c < columns.end; ++c)
          stored(c, r) = 1;
      }
    }
  }

  // Marks the samples within the margin of an edge. In each row only those near to the edge's line are tested.
  void mark_near(LatticePoint a, LatticePoint b) {
    const std::int64_t margin2 = std::int64_t{margin_} * margin_;
    const double dx = static_cast<double>(b.x) - a.x, dy = static_cast<double>(b.y) - a.y;
    const double low_x = std::min(a.x, b.x) - static_cast<double>(margin_),
                 high_x = std::max(a.x, b.x) + static_cast<double>(margin_);
    const double half_width =
        dy == 0 ? high_x - low_x : margin_ * std::hypot(dx, dy) / std::abs(dy) + 2;
    const CodeRange rows = between(y_, std::min(a.y, b.y) - static_cast<double>(margin_),
                                   std::max(a.y, b.y) + static_cast<double>(margin_));
    for (int r = rows.first; r < rows.end; ++r) {
      const std::int32_t y = y_[r];
      const double middle = dy == 0 ? a.x : a.x + (static_cast<double>(y) - a.y) / dy * dx;
      const CodeRange columns =
          between(x_, std::max(low_x, middle - half_width), std::min(high_x, middle + half_width));
      left_ -= 1 + std::max(0, columns.end - columns.first);
      for (int c = columns.first; c < columns.end; ++c) {
        char& is_stored = stored(c, r);
        if (is_stored == 0 && is_near_edge({x_[c], y}, a, b, margin2)) is_stored = 1;
      }
    }
  }

  std::int32_t margin_;
  GridAxis x_, y_;
  HuMask mask_;
  std::int64_t left_ = 0;  // steps of work that outlines of this size may take
};

// The samples of the box in steps, with a border. Samples that are not stored get a substitute, so that the predictor
// finds a value at each neighbour.
class PaddedPlane {
 public:
  explicit PaddedPlane(const HuMask& mask)
      : mask_(mask),
        width_(static_cast<std::size_t>(mask.columns) + 2 * kBorder),
        n_(width_ * (static_cast<std::size_t>(mask.rows) + kBorder), 0) {}

  // Calls visit(sample, column, row) for every stored sample, in order; columns and rows count from
  // the box. visit sets the sample and returns whether to go on.
  template <typename Visit>
  bool each(Visit visit) {
    for (int r = 0; r < mask_.rows; ++r) {
      std::int32_t* const row = n_.data() + (static_cast<std::size_t>(r) + kBorder) * width_;
      const std::size_t above =
          static_cast<std::size_t>(r) * static_cast<std::size_t>(mask_.columns);
      row[0] = row[1] =
          row[static_cast<std::ptrdiff_t>(kBorder) - static_cast<std::ptrdiff_t>(width_)];
      std::int64_t left = row[1];
      for (int c = 0; c < mask_.columns; ++c) {
        std::int32_t* const sample = row + static_cast<std::size_t>(c) + kBorder;
        if (mask_.is_stored[above + static_cast<std::size_t>(c)] != 0) {
          if (!visit(sample, c, r)) return false;
        } else {
          *sample =
              static_cast<std::int32_t>((left + sample[-static_cast<std::ptrdiff_t>(width_)]) >> 1);
        }
        left = *sample;
      }
      row[width_ - 2] = row[width_ - 1] = row[width_ - 3];
    }
    return true;
  }
  // The predictor's neighbours: left, above, above left, above right, second left, second above.
  std::array<std::int64_t, kNeighbours> neighbours(const std::int32_t* sample) const {
    const auto up = static_cast<std::ptrdiff_t>(width_);
    return {sample[-1], sample[-up], sample[-up - 1], sample[-up + 1], sample[-2], sample[-2 * up]};
  }
  std::int64_t predicted(const std::int32_t* sample, const Weights& weights) const {
    std::int64_t sum = std::int64_t{1} << (kWeightBits - 1);
    const auto values = neighbours(sample);
    for (std::size_t i = 0; i < values.size(); ++i)
      sum += weights[i] * values[i];
    return sum >> kWeightBits;
  }

 private:
  const HuMask& mask_;
  std::size_t width_;
  std::vector<std::int32_t> n_;
};

// Weights that minimise the sum of squared residuals of every third sample, slightly damped.
Weights best_weights(PaddedPlane& plane, const std::vector<std::int32_t>& samples) {
  using Matrix = Eigen::Matrix<double, kNeighbours, kNeighbours>;
  using Vector = Eigen::Matrix<double, kNeighbours, 1>;
  Matrix normal = Matrix::Identity() * (1e-3 * static_cast<double>(samples.size()) + 1e-9);
  Vector right = Vector::Zero();
  std::size_t next = 0;
  plane.each([&](std::int32_t* sample, int, int) {
    *sample = samples[next++];
    if (next % 3 != 0) return true;
    const auto neighbours = plane.neighbours(sample);
    for (int i = 0; i < kNeighbours; ++i) {
      const auto a = static_cast<double>(neighbours[static_cast<std::size_t>(i)]);
      right[i] += a * static_cast<double>(*sample);
      for (int j = 0; j <= i; ++j)
        normal(i, j) += a * static_cast<double>(neighbours[static_cast<std::size_t>(j)]);
    }
    return true;
  });
  const Vector best = normal.selfadjointView<Eigen::Lower>().ldlt().solve(right);
  Weights out{};
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double weight = std::rint(best[static_cast<Eigen::Index>(i)] * (1 << kWeightBits));
    out[i] =
        static_cast<std::int8_t>(std::isfinite(weight) ? std::clamp(weight, -127.0, 127.0) : 0);
  }
  return out;
}

// The stored samples in steps, with rounding errors passed on.
std::vector<std::int32_t> in_steps(const HuGrid& grid, const HuMask& mask,
                                   const std::function<float(int, int)>& value) {
  const auto width = static_cast<std::size_t>(mask.columns);
  std::vector<std::int32_t> out;
  std::vector<double> here(width + 2, 0),
      next(width + 2, 0);  // errors, from one column before the box
  for (int r = 0; r < mask.rows; ++r) {
    for (std::size_t c = 0; c < width; ++c) {
      if (mask.is_stored[static_cast<std::size_t>(r) * width + c] == 0) continue;
      const auto hu =
          static_cast<double>(value(mask.first_column + static_cast<int>(c), mask.first_row + r));
      const double wanted = (std::isnan(hu) ? 0 : hu) / grid.step_hu;
      const double exact = std::clamp(wanted + here[c + 1], -static_cast<double>(kMaxHuSteps),
                                      static_cast<double>(kMaxHuSteps));
      const double whole = std::rint(exact), error = exact - whole;
      here[c + 2] += error * 7 / 16;
      next[c] += error * 3 / 16;
      next[c + 1] += error * 5 / 16;
      next[c + 2] += error / 16;
      out.push_back(static_cast<std::int32_t>(whole));
    }
    here.swap(next);
    std::fill(next.begin(), next.end(), 0.0);
  }
  return out;
}

void put_varint(std::int64_t value, std::vector<std::uint8_t>& out) {
  auto rest = static_cast<std::uint64_t>(value >= 0 ? 2 * value : -2 * value - 1);
  for (; rest > 127; rest >>= 7)
    out.push_back(static_cast<std::uint8_t>(rest & 127) | 128);
  out.push_back(static_cast<std::uint8_t>(rest));
}

// Reads a deflated stream byte by byte.
class Inflater {
 public:
  explicit Inflater(std::span<const std::uint8_t> bytes) {
    stream_.next_in = const_cast<Bytef*>(bytes.data());
    stream_.avail_in = static_cast<uInt>(bytes.size());
    is_open_ = inflateInit(&stream_) == Z_OK;
  }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
  ~Inflater() {
    if (is_open_) inflateEnd(&stream_);
  }

  /// False at the end of the stream, and if it is damaged.
  bool next(std::uint8_t& byte) {
    if (at_ == size_ && !refill()) return false;
    byte = buffer_[at_++];
    return true;
  }
  /// Whether the stream is complete, its checksum is right and no byte follows.
  bool is_at_end() { return at_ == size_ && !refill() && is_complete_ && stream_.avail_in == 0; }

 private:
  bool refill() {
    at_ = size_ = 0;
    if (!is_open_ || is_complete_) return false;
    stream_.next_out = buffer_.data();
    stream_.avail_out = static_cast<uInt>(buffer_.size());
    const int result = inflate(&stream_, Z_NO_FLUSH);
    is_complete_ = result == Z_STREAM_END;
    if (result != Z_OK && !is_complete_) return false;
    size_ = buffer_.size() - stream_.avail_out;
    return size_ > 0;
  }

  z_stream stream_{};
  bool is_open_ = false, is_complete_ = false;
  std::array<std::uint8_t, 1 << 14> buffer_{};
  std::size_t at_ = 0, size_ = 0;
};

std::optional<std::int64_t> get_varint(Inflater& in) {
  std::uint64_t value = 0;
  for (int shift = 0; shift < 49; shift += 7) {
    std::uint8_t byte = 0;
    if (!in.next(byte)) return std::nullopt;
    value |= std::uint64_t{byte & 127U} << shift;
    if (byte < 128) {
      const auto half = static_cast<std::int64_t>(value >> 1);
      return (value & 1) == 0 ? half : -half - 1;
    }
  }
  return std::nullopt;
}

// Huffman codes alone: residuals of noise do not repeat, and searching for matches would enlarge them.
std::vector<std::uint8_t> deflated(const std::vector<std::uint8_t>& bytes) {
  z_stream stream{};
  deflateInit2(&stream, 1, Z_DEFLATED, 12, 8, Z_HUFFMAN_ONLY);
  std::vector<std::uint8_t> out(deflateBound(&stream, static_cast<uLong>(bytes.size())));
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = out.data();
  stream.avail_out = static_cast<uInt>(out.size());
  deflate(&stream, Z_FINISH);
  out.resize(out.size() - stream.avail_out);
  deflateEnd(&stream);
  return out;
}

}  // namespace

const std::array<Eigen::Vector2d, 19>& disc_points() noexcept {
  static const std::array<Eigen::Vector2d, 19> points = make_points();
  return points;
}

float HuPlane::at(double x_mm, double y_mm) const noexcept {
  const double x = (x_mm - origin_mm.x()) / pitch_mm.x(), y = (y_mm - origin_mm.y()) / pitch_mm.y();
  if (!(x > -1 && y > -1 && x < columns && y < rows)) return kNoHu;
  const double left = std::floor(x), below = std::floor(y), fx = x - left, fy = y - below;
  const int column = static_cast<int>(left), row = static_cast<int>(below);
  double sum = 0, weights = 0;
  for (int dy = 0; dy < 2; ++dy) {
    for (int dx = 0; dx < 2; ++dx) {
      const int c = column + dx, r = row + dy;
      if (c < 0 || r < 0 || c >= columns || r >= rows) continue;
      const float value = hu[static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) +
                             static_cast<std::size_t>(c)];
      if (std::isnan(value)) continue;
      const double weight = (dx == 1 ? fx : 1 - fx) * (dy == 1 ? fy : 1 - fy);
      sum += weight * static_cast<double>(value);
      weights += weight;
    }
  }
  return weights > 0 ? static_cast<float>(sum / weights) : kNoHu;
}

float HuPlane::mean(double x_mm, double y_mm, double radius_mm) const noexcept {
  double sum = 0;
  int count = 0;
  for (const Eigen::Vector2d& p : disc_points()) {
    const float value = at(x_mm + radius_mm * p.x(), y_mm + radius_mm * p.y());
    if (std::isnan(value)) continue;
    sum += static_cast<double>(value);
    ++count;
  }
  return count > 0 ? static_cast<float>(sum / count) : kNoHu;
}

const HuPlane* HuVolume::find(int index) const noexcept {
  const auto found =
      std::lower_bound(planes.begin(), planes.end(), index,
                       [](const HuPlane& plane, int wanted) { return plane.index < wanted; });
  return found != planes.end() && found->index == index ? &*found : nullptr;
}

float HuVolume::at(const Eigen::Vector3d& p_lps_mm) const noexcept {
  if (planes.empty()) return kNoHu;
  // The position in a plane's own frame; z is its height above the plane.
  const auto in_plane = [&](const HuPlane& plane) -> Eigen::Vector3d {
    return plane.T_lps_plane.linear().transpose() * (p_lps_mm - plane.T_lps_plane.translation());
  };
  const bool ascends =
      planes.size() < 2 || in_plane(planes.front()).z() >= in_plane(planes.back()).z();
  const auto above = std::partition_point(planes.begin(), planes.end(), [&](const HuPlane& plane) {
    return (in_plane(plane).z() >= 0) == ascends;
  });
  const auto value = [&](const HuPlane& plane) {
    const Eigen::Vector3d at_plane = in_plane(plane);
    return plane.at(at_plane.x(), at_plane.y());
  };
  if (above == planes.begin()) return value(*above);
  if (above == planes.end()) return value(planes.back());
  const HuPlane &low = *(above - 1), &high = *above;
  const double to_low = std::abs(in_plane(low).z()), to_high = std::abs(in_plane(high).z());
  const float a = value(low), b = value(high);
  if (std::isnan(a) || to_low + to_high == 0) return b;
  if (std::isnan(b)) return a;
  return static_cast<float>((static_cast<double>(a) * to_high + static_cast<double>(b) * to_low) /
                            (to_low + to_high));
}

std::uint64_t max_hu_samples(std::uint64_t file_bytes) {
  // The first limit admits large slices with two specks in opposite corners, which have
  // many samples for each of their bytes. The second one is for damaged and hostile files.
  return std::min((std::uint64_t{1} << 22) + 4096 * file_bytes,
                  (std::uint64_t{1} << 28) + 64 * file_bytes);
}

Result<void> check_hu_grid(const HuGrid& grid, const Lattice& lattice) {
  const auto is_axis = [&](double origin_mm, double pitch_mm, int count) {
    const double max_mm = lattice.to_mm(kMaxCoordinate / 2);
    return count > 0 && count <= kMaxHuSide && pitch_mm >= lattice.step_mm() &&
           std::abs(origin_mm) <= max_mm && pitch_mm * count <= max_mm;
  };
  if (!is_axis(grid.origin_mm.x(), grid.pitch_mm.x(), grid.columns) ||
      !is_axis(grid.origin_mm.y(), grid.pitch_mm.y(), grid.rows) || grid.step_hu < 1 ||
      grid.step_hu > (1 << 16) || grid.margin_steps == 0 || grid.margin_steps > kMaxHuMargin)
    return refused("a grid of HU that is out of range");
  if (grid.covers_everything() && std::int64_t{grid.columns} * grid.rows > kMaxHuSamples)
    return refused("a grid of more HU than a slice may have");
  return {};
}

Result<HuMask> hu_mask(const HuGrid& grid, const Lattice& lattice, Outlines outlines) {
  if (grid.covers_everything())
    return HuMask{
        0, 0, grid.columns, grid.rows,
        std::vector<char>(
            static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows), 1)};
  return MaskMaker(grid, lattice).make(outlines);
}

std::vector<std::uint8_t> encode_hu_plane(const HuGrid& grid, const HuMask& mask,
                                          const std::function<float(int, int)>& value) {
  const std::vector<std::int32_t> samples = in_steps(grid, mask, value);
  if (samples.empty()) return {};
  PaddedPlane plane(mask);
  const Weights weights = best_weights(plane, samples);
  std::vector<std::uint8_t> bytes(weights.begin(), weights.end());
  bytes.reserve(samples.size() + samples.size() / 8 + kNeighbours);
  std::size_t next = 0;
  plane.each([&](std::int32_t* sample, int, int) {
    const std::int64_t predicted = plane.predicted(sample, weights);
    *sample = samples[next++];
    put_varint(*sample - predicted, bytes);
    return true;
  });
  return deflated(bytes);
}

Result<HuPlane> decode_hu_plane(std::span<const std::uint8_t> bytes, const HuGrid& grid,
                                const Lattice& lattice, Outlines outlines) {
  const auto mask = hu_mask(grid, lattice, outlines);
  if (!mask) return mask.error();
  HuPlane out;
  out.origin_mm = grid.origin_mm +
                  grid.pitch_mm.cwiseProduct(Eigen::Vector2d(mask->first_column, mask->first_row));
  out.pitch_mm = grid.pitch_mm;
  out.first_column = mask->first_column;
  out.first_row = mask->first_row;
  out.columns = mask->columns;
  out.rows = mask->rows;
  const bool is_empty = std::none_of(mask->is_stored.begin(), mask->is_stored.end(),
                                     [](char stored) { return stored != 0; });
  if (is_empty != bytes.empty()) return refused("its HU are not those of its outlines");
  out.hu.assign(mask->is_stored.size(), std::numeric_limits<float>::quiet_NaN());
  if (is_empty) return out;
  const Error damaged = refused("its HU are damaged");
  Inflater in(bytes);
  Weights weights{};
  for (std::int8_t& weight : weights) {
    std::uint8_t byte = 0;
    if (!in.next(byte)) return damaged;
    weight = static_cast<std::int8_t>(byte);
  }
  PaddedPlane plane(*mask);
  const bool is_whole = plane.each([&](std::int32_t* sample, int c, int r) {
    const auto residual = get_varint(in);
    if (!residual) return false;
    const std::int64_t steps = plane.predicted(sample, weights) + *residual;
    if (std::abs(steps) > kMaxHuSteps) return false;
    *sample = static_cast<std::int32_t>(steps);
    out.hu[static_cast<std::size_t>(r) * static_cast<std::size_t>(out.columns) +
           static_cast<std::size_t>(c)] = static_cast<float>(steps * grid.step_hu);
    return true;
  });
  if (!is_whole || !in.is_at_end()) return damaged;
  return out;
}

}  // namespace trocar
