// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/scanner_table.h"

#include <algorithm>
#include <cmath>

#include "pipeline/read/parallel_for.h"
#include "pipeline/segment/components.h"

namespace trocar::pipeline {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kSamples = 10;
constexpr double kSampleBlock_mm = 2.5;
constexpr float kBody_HU = -300;     // fat is above, air, foam and lung are below
constexpr double kBodyDisc_mm = 10;  // radius of the disc that fits into a body
constexpr double kMinBody_mm2 = 4000;
constexpr double kSkin_mm = 5;  // what is nearer to the body may be a part of it
constexpr double kMinWidth_mm = 150, kMaxThickness_mm = 40;
constexpr double kMinCovered = 0.4;  // part of the width where something is; the body hides some
constexpr double kPresent = 0.6;     // part of the cross-section that must be there in a slice
constexpr double kBorder_mm = 3;     // distance at which a surface borders on air or on tissue
constexpr double kMinBare = 0.3, kMinInside = 0.8;
constexpr double kMaxTilt_deg = 35;

// A slice in blocks of pixels, row-major.
struct Blocks {
  int size = 1;  // pixels along each side of a block
  int width = 0, height = 0;
  std::vector<double> u_mm, v_mm;  // centres of columns and rows
  double area_mm2 = 0;             // of a block
  std::size_t count() const { return static_cast<std::size_t>(width) * height; }
  PlaneGrid grid() const { return {u_mm, v_mm}; }
};

Blocks blocks_of(const SliceStack& stack) {
  const SlicePlane& plane = stack.plane(0);
  Blocks out;
  const double pixel_mm = std::max(plane.spacing_u_mm, plane.spacing_v_mm);
  out.size = std::max(1, static_cast<int>(std::lround(std::min(kSampleBlock_mm / pixel_mm, 1e6))));
  out.size = std::min({out.size, stack.width(), stack.height()});
  out.width = stack.width() / out.size;
  out.height = stack.height() / out.size;
  for (int x = 0; x < out.width; ++x)
    out.u_mm.push_back(x * out.size * plane.spacing_u_mm);
  for (int y = 0; y < out.height; ++y)
    out.v_mm.push_back(y * out.size * plane.spacing_v_mm);
  out.area_mm2 = out.size * plane.spacing_u_mm * out.size * plane.spacing_v_mm;
  return out;
}

// Whether a table can be in the material at all.
bool is_possible(const SliceStack& stack, const Segmentation& how) {
  if (stack.pixel_unit() != PixelUnit::kHounsfield || !std::holds_alternative<Threshold>(how) ||
      stack.size() < 2)
    return false;
  const SlicePlane& plane = stack.plane(0);
  if (std::max(stack.width() * plane.spacing_u_mm, stack.height() * plane.spacing_v_mm) <
      kMinWidth_mm)
    return false;
  if (std::abs(plane.T_lps_plane.linear()(2, 2)) < std::cos(kMaxTilt_deg * M_PI / 180))
    return false;
  return static_cast<bool>(check_parallel(stack, 0, stack.size() - 1, ""));
}

// The sides of an image on which a table can lie: 0 up, 1 down, 2 left, 3 right.
constexpr std::size_t kSides = 4;

// The traces of a table in one slice, block by block.
struct Sample {
  Bytes stuff;                         // above kBody_HU in any pixel
  std::array<Bytes, kSides> sections;  // a table's cross-section on each side; empty if none
};

class Sampler {
 public:
  Sampler(const Blocks& blocks, float threshold) : blocks_(blocks), threshold_(threshold) {}

  Sample run(const Image& image) {
    Sample out;
    average(image, out.stuff);
    if (!find_body()) return out;
    std::vector<float> apart2;
    squared_distances(blocks_.grid(), body_, apart2);
    Bytes far(blocks_.count());
    for (std::size_t i = 0; i < far.size(); ++i)
      far[i] = out.stuff[i] != 0 && apart2[i] > float{kSkin_mm * kSkin_mm} ? 1 : 0;
    for (std::size_t side = 0; side < kSides; ++side) {
      Bytes section = beyond(far, side);
      if (is_table(section, side)) out.sections[side] = std::move(section);
    }
    return out;
  }

 private:
  std::size_t at(int x, int y) const { return static_cast<std::size_t>(y) * blocks_.width + x; }

  void average(const Image& image, Bytes& stuff) {
    stuff.assign(blocks_.count(), 0);
    tissue_.assign(blocks_.count(), 0);
    material_.assign(blocks_.count(), 0);
    const int n = blocks_.size;
    for (int by = 0; by < blocks_.height; ++by) {
      for (int bx = 0; bx < blocks_.width; ++bx) {
        int dense = 0;
        float high = -1e9F;
        for (int y = by * n; y < (by + 1) * n; ++y) {
          for (int x = bx * n; x < (bx + 1) * n; ++x) {
            const float value = image.at(x, y);
            dense += value >= kBody_HU ? 1 : 0;
            high = std::max(high, value);
          }
        }
        tissue_[at(bx, by)] = 2 * dense > n * n ? 1 : 0;
        stuff[at(bx, by)] = high >= kBody_HU ? 1 : 0;
        material_[at(bx, by)] = high >= threshold_ ? 1 : 0;
      }
    }
  }

  // Sets body_: the tissue that the disc fits into, without separate flat parts. Returns whether it
  // is large.
  bool find_body() {
    constexpr double kLimit_mm = kBodyDisc_mm * (1 + 1e-6);
    constexpr auto kLimit2 = static_cast<float>(kLimit_mm * kLimit_mm);
    Bytes set(blocks_.count());
    std::vector<float> apart2;
    for (std::size_t i = 0; i < set.size(); ++i)
      set[i] = tissue_[i] == 0 ? 1 : 0;
    squared_distances(blocks_.grid(), set, apart2);
    for (std::size_t i = 0; i < set.size(); ++i)
      set[i] = apart2[i] > kLimit2 ? 1 : 0;
    squared_distances(blocks_.grid(), set, apart2);
    body_.assign(blocks_.count(), 0);
    for (std::size_t i = 0; i < set.size(); ++i)
      body_[i] = apart2[i] <= kLimit2 && tissue_[i] != 0 ? 1 : 0;

    const VoxelGrid flat{{blocks_.u_mm, blocks_.v_mm, {0.0}}};
    const VoxelComponents parts = find_components(flat, body_);
    const auto& areas = parts.volume_mm3;
    const auto largest = std::max_element(areas.begin(), areas.end());
    if (largest == areas.end() || *largest < kMinBody_mm2) return false;
    std::vector<std::array<double, 4>> box(areas.size(), {1e9, -1e9, 1e9, -1e9});
    const auto width = static_cast<std::size_t>(blocks_.width);
    for (const VoxelComponents::Run& run : parts.runs) {
      auto& [u0, u1, v0, v1] = box[run.component];
      u0 = std::min(u0, blocks_.u_mm[run.begin % width]);
      u1 = std::max(u1, blocks_.u_mm[(run.end - 1) % width]);
      v0 = std::min(v0, blocks_.v_mm[run.begin / width]);
      v1 = std::max(v1, blocks_.v_mm[run.begin / width]);
    }
    for (const VoxelComponents::Run& run : parts.runs) {
      const auto& [u0, u1, v0, v1] = box[run.component];
      const double long_mm = std::max(u1 - u0, v1 - v0);
      const auto c = static_cast<std::ptrdiff_t>(run.component);
      if (areas.begin() + c == largest || long_mm < kMinWidth_mm ||
          areas[run.component] > kMaxThickness_mm * long_mm)
        continue;
      std::fill_n(&body_[run.begin], run.end - run.begin, std::uint8_t{0});
    }
    return true;
  }

  // Calls visit(line, block) for the blocks of each line towards a side, beginning at the side.
  template <typename Visit>
  void each_inwards(std::size_t side, const Visit& visit) const {
    const bool is_vertical = side < 2;
    const int lines = is_vertical ? blocks_.width : blocks_.height;
    const int length = is_vertical ? blocks_.height : blocks_.width;
    for (int line = 0; line < lines; ++line) {
      for (int step = 0; step < length; ++step) {
        const int i = side % 2 == 0 ? step : length - 1 - step;
        if (!visit(line, is_vertical ? at(line, i) : at(i, line))) break;
      }
    }
  }

  // The blocks of `far` that lie beyond the body on a side.
  Bytes beyond(const Bytes& far, std::size_t side) const {
    Bytes out(far.size(), 0);
    each_inwards(side, [&](int, std::size_t block) {
      out[block] = far[block];
      return body_[block] == 0;
    });
    return out;
  }

  // Whether a section is that of a table with material in it.
  bool is_table(const Bytes& section, std::size_t side) const {
    const std::vector<double>& at_mm = side < 2 ? blocks_.u_mm : blocks_.v_mm;
    std::vector<int> depth(at_mm.size(), 0);
    std::size_t blocks = 0;
    bool has_material = false;
    each_inwards(side, [&](int line, std::size_t block) {
      if (section[block] == 0) return true;
      ++depth[static_cast<std::size_t>(line)];
      ++blocks;
      has_material = has_material || material_[block] != 0;
      return true;
    });
    if (!has_material) return false;
    std::size_t first = at_mm.size(), last = 0, covered = 0;
    for (std::size_t i = 0; i < depth.size(); ++i) {
      if (depth[i] == 0) continue;
      first = std::min(first, i);
      last = i;
      ++covered;
    }
    const double line_mm = at_mm[1] - at_mm[0];
    const double width_mm = static_cast<double>(last - first + 1) * line_mm;
    const double covered_mm = static_cast<double>(covered) * line_mm;
    const double area_mm2 = static_cast<double>(blocks) * blocks_.area_mm2;
    return width_mm >= kMinWidth_mm && covered_mm >= kMinCovered * width_mm &&
           area_mm2 <= kMaxThickness_mm * covered_mm;
  }

  const Blocks& blocks_;
  float threshold_;
  Bytes tissue_, material_, body_;
};

// The blocks of a table's cross-section on one side, if half of the samples show one there and nine
// in ten have it, also where the body lies on it. Else empty, also if no block lies in half of the
// cross-sections.
Bytes common_section(const std::vector<Sample>& samples, std::size_t side) {
  std::vector<std::size_t> times(samples[0].stuff.size(), 0);
  std::size_t seen = 0, present = 0;
  for (const Sample& sample : samples) {
    const Bytes& section = sample.sections[side];
    if (!section.empty()) ++seen;
    for (std::size_t i = 0; i < section.size(); ++i)
      times[i] += section[i];
  }
  if (2 * seen < samples.size()) return {};
  for (const Sample& sample : samples) {
    double all = 0, found = 0;
    for (std::size_t i = 0; i < times.size(); ++i) {
      if (2 * times[i] < seen) continue;
      all += 1;
      found += sample.stuff[i];
    }
    if (all > 0 && found >= kPresent * all) ++present;
  }
  if (10 * present < 9 * samples.size()) return {};
  Bytes out(times.size());
  std::transform(times.begin(), times.end(), out.begin(), [seen](std::size_t n) {
    return static_cast<std::uint8_t>(n > 0 && 4 * n >= seen ? 1 : 0);
  });
  return out;
}

// The blocks of all tables' cross-sections, with a margin of one block; empty if there is no table.
Bytes find_section(const SliceStack& stack, const Blocks& blocks, float threshold) {
  const int count = std::min(kSamples, stack.size());
  std::vector<int> slices;
  slices.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i)
    slices.push_back(static_cast<int>((2 * std::int64_t{i} + 1) * stack.size() / (2 * count)));
  // Two slices in the middle decide about most scans.
  std::swap(slices[0], slices[static_cast<std::size_t>(count * 3 / 10)]);
  std::swap(slices[1], slices[static_cast<std::size_t>(count / 2)]);
  Sampler sampler(blocks, threshold);
  std::vector<Sample> samples;
  std::array<int, kSides> votes{};
  for (const int slice : slices) {
    const auto image = stack.read(slice);
    samples.push_back(image ? sampler.run(*image) : Sample{Bytes(blocks.count(), 0), {}});
    for (std::size_t side = 0; side < kSides; ++side)
      if (!samples.back().sections[side].empty()) ++votes[side];
    const int most = *std::max_element(votes.begin(), votes.end());
    const auto seen = static_cast<int>(samples.size());
    if ((seen == 2 && most == 0) || 2 * (most + count - seen) < count) return {};
  }
  Bytes out(blocks.count(), 0);
  for (std::size_t side = 0; side < kSides; ++side) {
    const Bytes section = common_section(samples, side);
    if (section.empty()) continue;
    for (int y = 0; y < blocks.height; ++y) {
      for (int x = 0; x < blocks.width; ++x) {
        if (section[static_cast<std::size_t>(y) * blocks.width + x] == 0) continue;
        for (int b = std::max(y - 1, 0); b <= std::min(y + 1, blocks.height - 1); ++b)
          for (int a = std::max(x - 1, 0); a <= std::min(x + 1, blocks.width - 1); ++a)
            out[static_cast<std::size_t>(b) * blocks.width + a] = 1;
      }
    }
  }
  if (std::none_of(out.begin(), out.end(), [](std::uint8_t o) { return o != 0; })) return {};
  return out;
}

// Flags of a voxel. The others have no meaning without the first.
enum TableFlag : std::uint8_t { kAbove = 1, kInTable = 2, kBare = 4, kCovered = 8 };

// Sets the flags of a slice's voxels.
void set_flags(const Image& image, float threshold, const SlicePlane& plane, const Blocks& blocks,
               const Bytes& section, std::uint8_t* flags) {
  const auto pixels = [](double spacing_mm) {
    return std::max(1, static_cast<int>(std::lround(std::min(kBorder_mm / spacing_mm, 1e6))));
  };
  const int far_u = pixels(plane.spacing_u_mm), far_v = pixels(plane.spacing_v_mm);
  const auto is_material = [&](int x, int y) { return image.at(x, y) >= threshold; };
  // kBare or kCovered if the material's surface in this direction borders on air or on tissue, else
  // 0.
  const auto border = [&](int x, int y, int dx, int dy, int far) -> unsigned {
    const auto exists = [&](int n) {
      const int a = x + n * dx, b = y + n * dy;
      return a >= 0 && b >= 0 && a < image.width && b < image.height;
    };
    if (!exists(1) || is_material(x + dx, y + dy)) return 0;
    if (!exists(far)) return kBare;
    const float value = image.at(x + far * dx, y + far * dy);
    if (value >= threshold) return 0;
    return value < kBody_HU ? kBare : kCovered;
  };
  for (int y = 0; y < image.height; ++y) {
    const int by = std::min(y / blocks.size, blocks.height - 1);
    for (int x = 0; x < image.width; ++x, ++flags) {
      *flags = 0;
      if (!is_material(x, y)) continue;
      *flags = kAbove;
      const int bx = std::min(x / blocks.size, blocks.width - 1);
      if (section[static_cast<std::size_t>(by) * blocks.width + bx] == 0) continue;
      *flags = static_cast<std::uint8_t>(kAbove | kInTable | border(x, y, -1, 0, far_u) |
                                         border(x, y, 1, 0, far_u) | border(x, y, 0, -1, far_v) |
                                         border(x, y, 0, 1, far_v));
    }
  }
}

struct Part {
  double inside_mm3 = 0;
  std::size_t bare = 0, covered = 0;
};

}  // namespace

std::optional<ScannerTable> ScannerTable::find(const SliceStack& stack, const Segmentation& how) {
  if (!is_possible(stack, how)) return std::nullopt;
  const Blocks blocks = blocks_of(stack);
  if (blocks.width < 2 || blocks.height < 2) return std::nullopt;
  const auto threshold = static_cast<float>(std::get<Threshold>(how).value);
  const Bytes section = find_section(stack, blocks, threshold);
  if (section.empty()) return std::nullopt;

  const VoxelGrid grid = grid_of(stack);
  const std::size_t pixels = grid.count(0) * grid.count(1);
  Bytes flags(grid.size(), 0);
  parallel_for(stack.size(), [&](int k) {
    const auto image = stack.read(k);
    if (image)
      set_flags(*image, threshold, stack.plane(0), blocks, section,
                &flags[static_cast<std::size_t>(k) * pixels]);
  });

  const VoxelComponents components = find_components(grid, flags);
  std::vector<Part> parts(components.volume_mm3.size());
  for (const VoxelComponents::Run& run : components.runs) {
    Part& part = parts[run.component];
    const std::size_t row = run.begin / grid.count(0);
    const double area_mm2 =
        grid.width_mm(1, row % grid.count(1)) * grid.width_mm(2, row / grid.count(1));
    for (std::size_t i = run.begin; i < run.end; ++i) {
      if ((flags[i] & kInTable) != 0) part.inside_mm3 += area_mm2 * grid.width_mm(0, 0);
      if ((flags[i] & kBare) != 0) ++part.bare;
      if ((flags[i] & kCovered) != 0) ++part.covered;
    }
  }
  std::vector<bool> is_table(parts.size());
  double removed_mm3 = 0, connected_mm3 = 0;
  for (std::size_t c = 0; c < parts.size(); ++c) {
    const Part& part = parts[c];
    const double volume_mm3 = components.volume_mm3[c];
    const bool is_bare =
        static_cast<double>(part.bare) >= kMinBare * static_cast<double>(part.bare + part.covered);
    if (!is_bare) continue;
    is_table[c] = part.inside_mm3 >= kMinInside * volume_mm3;
    (is_table[c] ? removed_mm3 : connected_mm3) += part.inside_mm3;
  }
  ScannerTable out;
  out.width_ = grid.count(0);
  out.height_ = grid.count(1);
  std::size_t lowest = grid.size(), highest = 0;
  for (const VoxelComponents::Run& run : components.runs) {
    if (!is_table[run.component]) continue;
    out.runs_.push_back({run.begin, run.end});
    lowest = std::min(lowest, run.begin / pixels);
    highest = std::max(highest, run.begin / pixels);
  }
  const auto millilitres = [](double mm3) {
    return mm3 < 950 ? std::string("less than 1 ml")
                     : std::to_string(std::lround(mm3 / 1000)) + " ml";
  };
  if (removed_mm3 > 0) {
    out.warnings_.push_back(
        {"table_removed", input_name(stack),
         "the scanner's table or a holder (" + millilitres(removed_mm3) + " in slices " +
             std::to_string(lowest) + " to " + std::to_string(highest) +
             ") is above the threshold and was left out; --keep-table keeps it"});
  }
  // Less than this is a cable, a speck of noise or the skin's edge.
  constexpr double kMinConnected = 0.2;
  if (connected_mm3 > kMinConnected * (removed_mm3 + connected_mm3)) {
    out.warnings_.push_back({"table_connected", input_name(stack),
                             "the scanner's table is above the threshold and connected with the "
                             "patient, so it was kept; --crop, --largest, --seed or a higher "
                             "--threshold can leave it out"});
  }
  return out;
}

void ScannerTable::remove(int slice, int offset_x, int offset_y, Field& field) const {
  const std::size_t pixels = width_ * height_, from = static_cast<std::size_t>(slice) * pixels;
  auto run = std::lower_bound(runs_.begin(), runs_.end(), from,
                              [](const Run& r, std::size_t begin) { return r.begin < begin; });
  for (; run != runs_.end() && run->begin < from + pixels; ++run) {
    for (std::size_t i = run->begin - from; i < run->end - from; ++i) {
      const int x = static_cast<int>(i % width_) - offset_x;
      const int y = static_cast<int>(i / width_) - offset_y;
      if (x < 0 || y < 0 || x >= field.image.width || y >= field.image.height) continue;
      put_on_side(field, static_cast<std::size_t>(y) * field.image.width + x, false);
    }
  }
}

}  // namespace trocar::pipeline
