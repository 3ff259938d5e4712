// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/segment/canals.h"

#include <cmath>
#include <queue>
#include <tuple>

#include "formats/base/disjoint_sets.h"
#include "pipeline/read/parallel_for.h"

namespace trocar::pipeline {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr double kMin_HU = -200, kStep_HU = 12;
constexpr int kHighestStep = 63;  // of packed HU
// Areas of a section, where the centre of the disc can be.
constexpr double kMinSection_mm2 = 15, kMaxSection_mm2 = 400;
// Sections are linked, and a followed section continues, if this part of the area overlaps.
constexpr double kOverlap = 0.35;
constexpr double kVertebrae_mm = 60;  // hardly any marrow is longer without bone across it
constexpr double kFollow_mm = 15;     // longest way through planes without a section of its own
constexpr double kFollowSlope = 0.5;
constexpr double kGrow_mm = kCanalDisc_mm + 3;  // from a section to the corners of the canal

struct Section {
  std::size_t plane = 0;
  double area_mm2 = 0, hu_sum = 0;
  double u_sum = 0, v_sum = 0;  // weighted by area
  bool is_soft = false;
  std::size_t tube = 0;
};

struct PlaneRun {
  std::size_t begin = 0, end = 0;  // pixels of a plane
  std::size_t section = 0;
};

// A rectangle of a plane.
struct Window {
  std::size_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // the ends are excluded
  std::size_t width() const { return x1 - x0; }
  std::size_t size() const { return width() * (y1 - y0); }
};

struct Followed {
  std::size_t plane = 0;
  Window window;
  Bytes pixels;
};

struct Tube {
  std::vector<std::size_t> sections;
  double median_mm2 = 0;
  std::size_t low = 0, high = 0;  // planes
  bool opens_low = false, opens_high = false;
  std::vector<Followed> followed;
};

class Finder {
 public:
  Finder(const VoxelPlanes& planes, std::span<const std::uint8_t> material,
         std::span<const std::uint8_t> hu, Bytes& flags)
      : planes_(planes), material_(material), hu_(hu), flags_(flags) {}

  std::vector<Canal> find() {
    find_sections();
    link();
    for (std::size_t t = 0; t < tubes_.size(); ++t) {
      follow(t, false);
      follow(t, true);
    }
    std::vector<Canal> out = choose();
    parallel_for(static_cast<int>(planes_.count()),
                 [this](int k) { grow(static_cast<std::size_t>(k)); });
    return out;
  }

 private:
  double u_mm(std::size_t x) const { return planes_.grid.at_mm[planes_.u][x]; }
  double v_mm(std::size_t y) const { return planes_.grid.at_mm[planes_.v][y]; }
  double at_mm(std::size_t plane) const { return planes_.grid.at_mm[planes_.across][plane]; }
  double area_mm2(std::size_t x, std::size_t y) const {
    return planes_.grid.width_mm(planes_.u, x) * planes_.grid.width_mm(planes_.v, y);
  }
  // The longer side of a pixel, slightly enlarged against rounding.
  double pixel_mm(std::size_t x, std::size_t y) const {
    return std::max(planes_.grid.width_mm(planes_.u, x), planes_.grid.width_mm(planes_.v, y)) *
           (1 + 1e-6);
  }
  double widest_pixel_mm() const {
    double out = 0;
    for (std::size_t x = 0; x < planes_.width(); ++x)
      out = std::max(out, pixel_mm(x, 0));
    for (std::size_t y = 0; y < planes_.height(); ++y)
      out = std::max(out, pixel_mm(0, y));
    return out;
  }
  // Without HU everything is soft.
  double hu(std::size_t voxel) const { return hu_.empty() ? 0 : unpacked_hu(hu_[voxel]); }
  static bool is_soft(double area_mm2, double hu_sum) { return hu_sum < kMaxCanal_HU * area_mm2; }

  void find_sections() {
    const std::size_t width = planes_.width(), pixels = planes_.plane().size();
    const VoxelGrid flat{{planes_.grid.at_mm[planes_.u], planes_.grid.at_mm[planes_.v], {0.0}}};
    runs_.resize(planes_.count());
    std::vector<std::vector<Section>> found(planes_.count());
    parallel_for(static_cast<int>(planes_.count()), [&](int plane) {
      const auto k = static_cast<std::size_t>(plane);
      thread_local Bytes wide;
      wide.resize(pixels);
      planes_.each(k, [&](std::size_t i, std::size_t voxel) {
        constexpr std::uint8_t kBoth = kEnclosed | kWide;
        wide[i] = (flags_[voxel] & kBoth) == kBoth ? 1 : 0;
      });
      const VoxelComponents parts = find_components(flat, wide);
      std::vector<Section>& sections = found[k];
      sections.resize(parts.volume_mm3.size());
      for (const VoxelComponents::Run& run : parts.runs) {
        runs_[k].push_back({run.begin, run.end, run.component});
        Section& section = sections[run.component];
        section.plane = k;
        for (std::size_t i = run.begin; i < run.end; ++i) {
          const std::size_t x = i % width, y = i / width;
          const double area = area_mm2(x, y);
          section.area_mm2 += area;
          section.hu_sum += area * hu(planes_.voxel(k, x, y));
          section.u_sum += area * u_mm(x);
          section.v_sum += area * v_mm(y);
        }
      }
    });
    for (std::size_t k = 0; k < found.size(); ++k) {
      for (PlaneRun& run : runs_[k])
        run.section += sections_.size();
      for (Section& section : found[k]) {
        section.is_soft = section.area_mm2 >= kMinSection_mm2 &&
                          section.area_mm2 <= kMaxSection_mm2 &&
                          is_soft(section.area_mm2, section.hu_sum);
        sections_.push_back(section);
      }
    }
  }

  // The areas by which soft sections of plane k and of the next one overlap.
  std::map<std::pair<std::size_t, std::size_t>, double> overlaps(std::size_t k) const {
    std::map<std::pair<std::size_t, std::size_t>, double> out;
    const std::size_t width = planes_.width();
    const std::vector<PlaneRun>&a = runs_[k], &b = runs_[k + 1];
    for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
      const std::size_t from = std::max(a[i].begin, b[j].begin), to = std::min(a[i].end, b[j].end);
      if (from < to && sections_[a[i].section].is_soft && sections_[b[j].section].is_soft) {
        double& area = out[{a[i].section, b[j].section}];
        for (std::size_t p = from; p < to; ++p)
          area += area_mm2(p % width, p / width);
      }
      (a[i].end < b[j].end ? i : j) += 1;
    }
    return out;
  }

  // Joins the sections to tubes.
  void link() {
    DisjointSets joined(sections_.size());
    for (std::size_t k = 0; k + 1 < planes_.count(); ++k) {
      for (const auto& [pair, area] : overlaps(k)) {
        const std::size_t a = pair.first, b = pair.second;
        if (area < kOverlap * std::max(sections_[a].area_mm2, sections_[b].area_mm2)) continue;
        joined.join(static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b));
      }
    }
    constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
    std::vector<std::size_t> tube_of(sections_.size(), kNone);
    for (std::size_t s = 0; s < sections_.size(); ++s) {
      if (!sections_[s].is_soft) continue;
      std::size_t& tube = tube_of[joined.root(static_cast<std::uint32_t>(s))];
      if (tube == kNone) {
        tube = tubes_.size();
        tubes_.emplace_back();
        tubes_.back().low = sections_[s].plane;
      }
      sections_[s].tube = tube;
      tubes_[tube].high = sections_[s].plane;
      tubes_[tube].sections.push_back(s);
    }
    groups_ = DisjointSets(tubes_.size());
    for (Tube& tube : tubes_) {
      std::vector<double> areas;
      for (const std::size_t s : tube.sections)
        areas.push_back(sections_[s].area_mm2);
      const auto middle = areas.begin() + static_cast<std::ptrdiff_t>(areas.size() / 2);
      std::nth_element(areas.begin(), middle, areas.end());
      tube.median_mm2 = *middle;
    }
  }

  // The smallest window that holds the pixels, with a margin.
  template <typename Each>
  Window window_of(const Each& each_pixel, double margin_mm) const {
    std::size_t x0 = planes_.width(), y0 = planes_.height(), x1 = 0, y1 = 0;
    each_pixel([&](std::size_t x, std::size_t y) {
      x0 = std::min(x0, x), y0 = std::min(y0, y);
      x1 = std::max(x1, x + 1), y1 = std::max(y1, y + 1);
    });
    const auto low = [margin_mm](const std::vector<double>& at, std::size_t i) {
      return static_cast<std::size_t>(std::lower_bound(at.begin(), at.end(), at[i] - margin_mm) -
                                      at.begin());
    };
    const auto high = [margin_mm](const std::vector<double>& at, std::size_t i) {
      return static_cast<std::size_t>(
          std::upper_bound(at.begin(), at.end(), at[i - 1] + margin_mm) - at.begin());
    };
    const std::vector<double>&u = planes_.grid.at_mm[planes_.u], &v = planes_.grid.at_mm[planes_.v];
    return {low(u, x0), low(v, y0), high(u, x1), high(v, y1)};
  }

  // A plane's sections of one tube.
  template <typename Visit>
  void each_pixel(std::size_t plane, std::size_t tube, const Visit& visit) const {
    for (const PlaneRun& run : runs_[plane]) {
      const Section& section = sections_[run.section];
      if (!section.is_soft || section.tube != tube) continue;
      for (std::size_t i = run.begin; i < run.end; ++i)
        visit(i % planes_.width(), i / planes_.width());
    }
  }

  // Follows a tube beyond its last plane on one side until it is blocked, meets another tube or has
  // come too far.
  void follow(std::size_t t, bool up) {
    Tube& tube = tubes_[t];
    std::size_t k = up ? tube.high : tube.low;
    const double from_mm = at_mm(k);
    const std::size_t last = planes_.count() - 1;
    const auto visit_all = [&](const auto& visit) { each_pixel(k, t, visit); };
    Followed now{k, window_of(visit_all, widest_pixel_mm() + kFollowSlope * kFollow_mm), {}};
    const Window& w = now.window;
    now.pixels.assign(w.size(), 0);
    visit_all(
        [&](std::size_t x, std::size_t y) { now.pixels[(y - w.y0) * w.width() + x - w.x0] = 1; });
    std::vector<float> apart2;
    const PlaneGrid grid{std::span(planes_.grid.at_mm[planes_.u]).subspan(w.x0, w.width()),
                         std::span(planes_.grid.at_mm[planes_.v]).subspan(w.y0, w.y1 - w.y0)};
    squared_distances(grid, now.pixels, apart2);
    for (bool first = true;; first = false) {
      if (k == (up ? last : 0)) {
        (up ? tube.opens_high : tube.opens_low) = true;
        return;
      }
      k = up ? k + 1 : k - 1;
      const double way_mm = std::abs(at_mm(k) - from_mm);
      if (way_mm > kFollow_mm && !first) return;
      if (!step(k, apart2, kFollowSlope * way_mm, now)) return;
      double area = 0, open = 0, sum = 0;
      each_set(now, [&](std::size_t x, std::size_t y) {
        const std::size_t voxel = planes_.voxel(k, x, y);
        const double pixel = area_mm2(x, y);
        area += pixel;
        sum += pixel * hu(voxel);
        if ((flags_[voxel] & kEnclosed) == 0) open += pixel;
      });
      if (area < kOverlap * tube.median_mm2 || !is_soft(area, sum)) return;
      tube.followed.push_back(now);
      if (open >= kOverlap * tube.median_mm2) (up ? tube.opens_high : tube.opens_low) = true;
      if (join_met(t, now, area)) return;
    }
  }

  template <typename Visit>
  static void each_set(const Followed& of, const Visit& visit) {
    const Window& w = of.window;
    for (std::size_t i = 0; i < of.pixels.size(); ++i)
      if (of.pixels[i] != 0) visit(w.x0 + i % w.width(), w.y0 + i / w.width());
  }

  // Replaces a section by its neighbourhood in plane k, as far as a disc fits there and it is not
  // farther from the tube's end than a pixel and `shift_mm`. Returns whether anything is left.
  bool step(std::size_t k, const std::vector<float>& apart2, double shift_mm, Followed& now) const {
    const Window& w = now.window;
    const std::size_t width = w.width(), height = w.y1 - w.y0;
    Bytes next(now.pixels.size(), 0);
    bool any = false;
    for (std::size_t y = 0; y < height; ++y) {
      for (std::size_t x = 0; x < width; ++x) {
        const std::size_t i = y * width + x;
        if ((flags_[planes_.voxel(k, w.x0 + x, w.y0 + y)] & kWide) == 0) continue;
        const double far_mm = pixel_mm(w.x0 + x, w.y0 + y) + shift_mm;
        if (apart2[i] > static_cast<float>(far_mm * far_mm)) continue;
        const std::size_t top = y > 0 ? y - 1 : y, bottom = std::min(y + 1, height - 1);
        const std::size_t left = x > 0 ? x - 1 : x, right = std::min(x + 1, width - 1);
        for (std::size_t b = top; b <= bottom && next[i] == 0; ++b)
          for (std::size_t a = left; a <= right; ++a)
            if (now.pixels[b * width + a] != 0) next[i] = 1;
        any = any || next[i] != 0;
      }
    }
    now.plane = k;
    now.pixels.swap(next);
    return any;
  }

  // Joins the tube with those whose sections overlap with what was followed.
  bool join_met(std::size_t t, const Followed& now, double area) {
    std::map<std::size_t, double> met;
    const Window& w = now.window;
    for (const PlaneRun& run : runs_[now.plane]) {
      if (!sections_[run.section].is_soft) continue;
      const std::size_t y = run.begin / planes_.width();
      if (y < w.y0 || y >= w.y1) continue;
      const std::size_t row = y * planes_.width();
      for (std::size_t x = std::max(run.begin - row, w.x0); x < std::min(run.end - row, w.x1); ++x)
        if (now.pixels[(y - w.y0) * w.width() + x - w.x0] != 0) met[run.section] += area_mm2(x, y);
    }
    bool any = false;
    for (const auto& [section, overlap] : met) {
      if (overlap < kOverlap * std::max(area, sections_[section].area_mm2)) continue;
      groups_.join(static_cast<std::uint32_t>(t),
                   static_cast<std::uint32_t>(sections_[section].tube));
      any = true;
    }
    return any;
  }

  // Decides which groups of tubes are canals, and marks their sections.
  std::vector<Canal> choose() {
    struct Group {
      double low_mm = 0, high_mm = 0;
      bool opens_low = false, opens_high = false;
      std::vector<std::size_t> tubes;
    };
    std::map<std::size_t, Group> groups;
    for (std::size_t t = 0; t < tubes_.size(); ++t) {
      const Tube& tube = tubes_[t];
      Group& one = groups[groups_.root(static_cast<std::uint32_t>(t))];
      const double low = at_mm(tube.low), high = at_mm(tube.high);
      one.low_mm = one.tubes.empty() ? low : std::min(one.low_mm, low);
      one.high_mm = one.tubes.empty() ? high : std::max(one.high_mm, high);
      one.opens_low = one.opens_low || tube.opens_low;
      one.opens_high = one.opens_high || tube.opens_high;
      one.tubes.push_back(t);
    }
    std::vector<Canal> out;
    for (const auto& [first, one] : groups) {
      const double length_mm = one.high_mm - one.low_mm;
      const bool is_long = length_mm >= kVertebrae_mm;
      if (!(one.opens_low && one.opens_high) && !(is_long && (one.opens_low || one.opens_high)))
        continue;
      out.push_back({{}, length_mm});
      for (const std::size_t t : one.tubes)
        mark(t, out.back());
      std::sort(out.back().sections.begin(), out.back().sections.end(),
                [](const Canal::Section& a, const Canal::Section& b) {
                  return std::tie(a.plane, a.u_mm, a.v_mm) < std::tie(b.plane, b.u_mm, b.v_mm);
                });
    }
    std::stable_sort(out.begin(), out.end(),
                     [](const Canal& a, const Canal& b) { return a.length_mm > b.length_mm; });
    return out;
  }

  void mark(std::size_t t, Canal& canal) {
    const Tube& tube = tubes_[t];
    for (const std::size_t s : tube.sections) {
      const Section& section = sections_[s];
      canal.sections.push_back(
          {section.plane, section.u_sum / section.area_mm2, section.v_sum / section.area_mm2});
    }
    for (std::size_t k = tube.low; k <= tube.high; ++k)
      each_pixel(k, t, [&](std::size_t x, std::size_t y) {
        flags_[planes_.voxel(k, x, y)] |= kInSection;
      });
    for (const Followed& one : tube.followed) {
      each_set(one, [&](std::size_t x, std::size_t y) {
        flags_[planes_.voxel(one.plane, x, y)] |= kInSection;
      });
    }
  }

  // Gives a plane's free pixels near a canal's section to the canal, as far as they are not nearer
  // to another section.
  void grow(std::size_t k) {
    const auto each_middle = [&](const auto& visit) {
      for (std::size_t y = 0; y < planes_.height(); ++y)
        for (std::size_t x = 0; x < planes_.width(); ++x)
          if ((flags_[planes_.voxel(k, x, y)] & kInSection) != 0) visit(x, y);
    };
    const Window w = [&]() -> Window {
      bool any = false;
      each_middle([&any](std::size_t, std::size_t) { any = true; });
      return any ? window_of(each_middle, 2 * kGrow_mm) : Window{};
    }();
    if (w.size() == 0) return;
    constexpr std::uint8_t kOther = 2, kCanal = 1;
    using Step = std::tuple<float, std::uint8_t, std::size_t>;  // way in mm, owner, pixel
    std::priority_queue<Step, std::vector<Step>, std::greater<>> front;
    std::vector<float> way(w.size(), std::numeric_limits<float>::infinity());
    Bytes owner(w.size(), 0);
    const auto voxel_of = [&](std::size_t i) {
      return planes_.voxel(k, w.x0 + i % w.width(), w.y0 + i / w.width());
    };
    for (std::size_t i = 0; i < way.size(); ++i) {
      const std::uint8_t flag = flags_[voxel_of(i)];
      constexpr std::uint8_t kBoth = kEnclosed | kWide;
      if ((flag & kInSection) == 0 && (flag & kBoth) != kBoth) continue;
      owner[i] = (flag & kInSection) != 0 ? kCanal : kOther;
      way[i] = 0;
      front.emplace(0.0F, owner[i], i);
    }
    while (!front.empty()) {
      const auto [here, whose, i] = front.top();
      front.pop();
      if (here > way[i]) continue;
      const std::size_t x = i % w.width(), y = i / w.width();
      for (std::size_t b = y > 0 ? y - 1 : y; b <= y + 1 && b < w.y1 - w.y0; ++b) {
        for (std::size_t a = x > 0 ? x - 1 : x; a <= x + 1 && a < w.width(); ++a) {
          const std::size_t other = b * w.width() + a;
          const double du = u_mm(w.x0 + a) - u_mm(w.x0 + x), dv = v_mm(w.y0 + b) - v_mm(w.y0 + y);
          const auto there =
              static_cast<float>(static_cast<double>(here) + std::sqrt(du * du + dv * dv));
          if (there >= way[other] || there > static_cast<float>(kGrow_mm) ||
              material_[voxel_of(other)] != 0)
            continue;
          way[other] = there;
          owner[other] = whose;
          front.emplace(there, whose, other);
        }
      }
    }
    for (std::size_t i = 0; i < owner.size(); ++i)
      if (owner[i] == kCanal) flags_[voxel_of(i)] |= kInCanal;
  }

  const VoxelPlanes& planes_;
  std::span<const std::uint8_t> material_, hu_;
  Bytes& flags_;
  std::vector<std::vector<PlaneRun>> runs_;  // of each plane, in ascending order
  std::vector<Section> sections_;
  std::vector<Tube> tubes_;
  DisjointSets groups_;  // of tubes that are parts of the same canal
};

}  // namespace

std::vector<Canal> find_canals(const VoxelPlanes& planes, std::span<const std::uint8_t> material,
                               std::span<const std::uint8_t> hu, std::vector<std::uint8_t>& flags) {
  return Finder(planes, material, hu, flags).find();
}

std::uint8_t packed_hu(float value) {
  const double step = std::floor((static_cast<double>(value) - kMin_HU) / kStep_HU);
  return static_cast<std::uint8_t>(
      static_cast<unsigned>(std::clamp(step, 0.0, double{kHighestStep})) << 2);
}

double unpacked_hu(std::uint8_t packed) {
  return kMin_HU + kStep_HU * ((packed >> 2) + 0.5);
}

bool is_in_highest_step(std::uint8_t packed) {
  return (packed >> 2) == kHighestStep;
}

}  // namespace trocar::pipeline
