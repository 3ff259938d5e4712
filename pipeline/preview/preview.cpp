// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/preview.h"

#include <cstdio>
#include <new>

#include "pipeline/bake/report.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

constexpr int kMaxProbes = 64;
constexpr double kBins = 200;
// Limit of the labels of a slice that are counted although they are not wanted, for a CT that is
// mistaken for a label map.
constexpr std::size_t kMaxLabelsCounted = 4096;

const Labels* labels_of(const Segmentation& how) {
  return std::get_if<Labels>(&how);
}

// The letters of a direction in patient coordinates (LPS).
std::string letters_of(const Eigen::Vector3d& direction) {
  const double kMin = std::sin(15 * M_PI / 180);
  std::array<int, 3> axis{0, 1, 2};
  std::stable_sort(axis.begin(), axis.end(),
                   [&](int a, int b) { return std::abs(direction[a]) > std::abs(direction[b]); });
  std::string out;
  for (const int k : axis) {
    if (!out.empty() && std::abs(direction[k]) < kMin) break;
    out += direction[k] > 0 ? "LPS"[k] : "RAI"[k];
  }
  return out;
}

// The smallest of 1, 2 or 5 times a power of ten that is not below `value`.
double nice(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (value <= factor * power * (1 + 1e-9)) return factor * power;
  }
  return 10 * power;
}

double area_of(const Pslg& contours, const Lattice& lattice) {
  return 0.5 * static_cast<double>(doubled_area(contours)) * lattice.step_mm() * lattice.step_mm();
}

// The results of one slice. Slices are computed in parallel.
struct OneSlice {
  PreviewSlice shown;
  ValueTally tally;
  double low = 0, high = 0, cut = 0;
  std::vector<double> areas;  // area for each change
  std::vector<std::size_t> outlines;
  std::vector<std::int64_t> counts;
  std::map<int, std::int64_t> label_voxels;
  bool has_uncounted = false;  // more labels than are counted
};

EdgeLetters edge_letters(const SlicePlane& plane) {
  const Eigen::Matrix3d& R = plane.T_lps_plane.linear();
  return {letters_of(-R.col(0)), letters_of(R.col(0)), letters_of(-R.col(1)), letters_of(R.col(1))};
}

class Maker {
 public:
  Maker(const SliceStack& stack, const StackOptions& options) : stack_(stack), options_(options) {}

  Result<Preview> make(int count) {
    first_ = options_.slices ? options_.slices->first : 0;
    last_ = options_.slices ? options_.slices->second : stack_.size() - 1;
    std::optional<ScannerTable> table;
    if (!options_.keep_table) table = ScannerTable::find(stack_, options_.mesh.segmentation);
    if (table) {
      options_.mesh.table = &*table;
      of_volume_ = table->warnings();
    }
    std::optional<SolidBone> solid;
    if (options_.solid.any()) {
      auto made = SolidBone::make(stack_, options_.mesh.segmentation, options_.axis, options_.solid,
                                  options_.mesh.table);
      if (!made) return made.error();
      solid = std::move(*made);
      options_.mesh.solid = &*solid;
      of_volume_.insert(of_volume_.end(), solid->warnings().begin(), solid->warnings().end());
    }
    const auto ends = find_ends();
    if (!ends) return ends.error();
    choose(*ends, count);
    if (auto ok = in_parallel(slices_.size(), [this](auto i) { return read_slice(slices_[i]); });
        !ok)
      return ok.error();
    start();
    if (auto ok = in_parallel(slices_.size(), [this](auto i) { return count_in(slices_[i]); }); !ok)
      return ok.error();
    finish();
    return std::move(out_);
  }

 private:
  using Work = std::function<Result<void>(std::size_t)>;

  // Calls the work for each index in parallel. If several fail, returns the error with the lowest
  // index.
  Result<void> in_parallel(std::size_t count, const Work& work) {
    const auto is_stopped = [this] { return options_.stop != nullptr && options_.stop->load(); };
    auto done = try_in_parallel(static_cast<int>(count), [&](int i) -> Result<void> {
      if (is_stopped()) return {};
      try {
        return work(static_cast<std::size_t>(i));
      } catch (const std::bad_alloc&) {
        return refused_for_now("not enough memory for these slices");
      }
    });
    if (is_stopped()) return unwritable("interrupted; nothing was written");
    return done;
  }

  // The contours of a slice. Sets `values` to the statistics of its pixels. Errors: those of
  // segment_slice(), which meshing would have, too.
  Result<Pslg> contours_at(int slice, Pixels shown, ValueTally& values) const {
    MeshedSlice segmented;
    const auto pixels =
        segment_slice(stack_, slice, options_.mesh, {std::move(shown), {}}, segmented);
    if (!pixels) return pixels.error().after(stack_.name(slice) + ": ");
    values = std::move(segmented.values);
    return contours_of(stack_, slice, options_.mesh, pixels->field);
  }

  Result<bool> has_material(int slice) const {
    if (auto ok = check_lattice(stack_, slice, options_.mesh.lattice); !ok) return ok.error();
    auto pixels = read_cropped(stack_, slice, options_.mesh);
    if (!pixels) return pixels.error();
    ValueTally ignored;
    const auto contours = contours_at(slice, std::move(*pixels), ignored);
    if (!contours) return contours.error();
    return !contours->rings.empty();
  }

  // Determines for each of these slices whether it has material.
  Result<std::vector<bool>> probe(const std::vector<int>& slices) {
    std::vector<char> found(slices.size());
    auto ok = in_parallel(slices.size(), [&](std::size_t i) -> Result<void> {
      const auto has = has_material(slices[i]);
      if (!has) return has.error();
      found[i] = *has ? 1 : 0;
      return {};
    });
    if (!ok) return ok.error();
    return std::vector<bool>(found.begin(), found.end());
  }

  // Bisects between `outside`, a slice without material, and `inside`, a slice with material.
  // Returns the outermost slice with material.
  Result<int> border(int outside, int inside) const {
    while (std::abs(inside - outside) > 1) {
      const int middle = outside + (inside - outside) / 2;
      const auto has = has_material(middle);
      if (!has) return has.error();
      (*has ? inside : outside) = middle;
    }
    return inside;
  }

  // Finds the first and the last slice with material.
  Result<std::pair<int, int>> find_ends() {
    const int all = last_ - first_ + 1;
    for (const int probes : {std::min(all, kMaxProbes), all}) {
      std::vector<int> slices;
      slices.reserve(static_cast<std::size_t>(probes));
      for (std::int64_t i = 0; i < probes; ++i) {
        const std::int64_t further = probes == 1 ? 0 : i * (all - 1) / (probes - 1);
        slices.push_back(first_ + static_cast<int>(further));
      }
      const auto found = probe(slices);
      if (!found) return found.error();
      out_.inspected = probes < all ? probes : 0;
      const auto from = std::find(found->begin(), found->end(), true) - found->begin();
      if (from == static_cast<std::ptrdiff_t>(slices.size())) continue;
      const auto to = found->rend() - std::find(found->rbegin(), found->rend(), true) - 1;
      const auto at = [&slices](std::ptrdiff_t i) { return slices[static_cast<std::size_t>(i)]; };
      const auto low = from == 0 ? Result<int>(at(0)) : border(at(from - 1), at(from));
      if (!low) return low.error();
      const bool is_last = to + 1 == static_cast<std::ptrdiff_t>(slices.size());
      const auto high = is_last ? Result<int>(at(to)) : border(at(to + 1), at(to));
      if (!high) return high.error();
      return std::pair{*low, *high};
    }
    return empty_asset_error(stack_, first_, last_, options_.mesh);
  }

  void choose(const std::pair<int, int>& ends, int count) {
    const int all = ends.second - ends.first + 1, shown = std::min(count, all);
    for (int i = 0; i < shown; ++i) {
      const double part = shown == 1 ? 0.5 : static_cast<double>(i) / (shown - 1);
      slices_.emplace_back();
      slices_.back().shown.index = ends.first + static_cast<int>(std::lround(part * (all - 1)));
    }
  }

  Result<void> read_slice(OneSlice& one) const {
    PreviewSlice& shown = one.shown;
    shown.plane = stack_.plane(shown.index);
    if (stack_.pixel_unit() != PixelUnit::kGrey) shown.letters = edge_letters(shown.plane);
    if (const auto ok = read_cropped(stack_, shown.index, options_.mesh).into(shown.pixels); !ok)
      return ok.error();
    if (const auto ok = contours_at(shown.index, shown.pixels, one.tally).into(shown.contours); !ok)
      return ok.error();
    shown.area_mm2 = area_of(shown.contours, options_.mesh.lattice);
    std::visit(
        [&one](const auto& image) {
          const auto [low, high] = std::minmax_element(image.values.begin(), image.values.end());
          one.low = static_cast<double>(*low);
          one.high = static_cast<double>(*high);
        },
        shown.pixels);
    return {};
  }

  // Computes the values over all slices that the second pass needs.
  void start() {
    out_.low = slices_[0].low;
    out_.high = slices_[0].high;
    for (const OneSlice& one : slices_) {
      out_.low = std::min(out_.low, one.low);
      out_.high = std::max(out_.high, one.high);
    }
    out_.unit = stack_.pixel_unit();
    out_.segmentation = options_.mesh.segmentation;
    if (const Labels* labels = labels_of(out_.segmentation)) {
      for (const int label : labels->labels)
        out_.label_voxels[label] = 0;
      return;
    }
    const auto* threshold = std::get_if<Threshold>(&out_.segmentation);
    const double value =
        threshold != nullptr ? threshold->value : std::get<Equalize>(out_.segmentation).level;
    double step = 5;  // of levels
    if (threshold != nullptr && out_.unit == PixelUnit::kHounsfield) step = 20;
    if (threshold != nullptr && out_.unit == PixelUnit::kUncalibrated)
      step = nice(std::max(out_.high - out_.low, 1e-6) / 100);
    const double far = step == 20 ? 50 : 2 * step;
    for (const double change : {-far, -step, 0.0, step, far})
      out_.changes.push_back({change, value + change, 0, 0});
    double low = out_.low, high = std::max(out_.high, low + 1e-6);
    if (out_.unit == PixelUnit::kHounsfield) {
      // The range is limited, because metal and the padding outside the scanner's circle would
      // leave few bins for tissue.
      low = std::max(low, -1100.0);
      high = std::max(low + 1, std::min(high, std::max(3000.0, value + 500)));
    }
    Histogram& histogram = out_.histogram;
    histogram.width = nice((high - low) / kBins);
    if (out_.unit != PixelUnit::kUncalibrated)
      histogram.width = std::max(histogram.width, out_.high - out_.low > 2 ? 1.0 : 0.0);
    histogram.low = std::floor(low / histogram.width) * histogram.width;
    histogram.counts.resize(
        static_cast<std::size_t>(std::floor((high - histogram.low) / histogram.width)) + 1);
  }

  Result<void> count_in(OneSlice& one) const {
    if (const Labels* wanted = labels_of(out_.segmentation)) {
      for (const int label : std::get<LabelImage>(one.shown.pixels).values) {
        if (label == 0) continue;
        if (one.label_voxels.size() < kMaxLabelsCounted || one.label_voxels.contains(label) ||
            wanted->all || wanted->labels.contains(label))
          ++one.label_voxels[label];
        else
          one.has_uncounted = true;
      }
      return {};
    }
    const Image& image = std::get<Image>(one.shown.pixels);
    const auto bins = static_cast<double>(out_.histogram.counts.size());
    one.counts.resize(out_.histogram.counts.size());
    for (const float value : image.values) {
      const double bin = std::floor((double{value} - out_.histogram.low) / out_.histogram.width);
      ++one.counts[static_cast<std::size_t>(std::clamp(bin, 0.0, bins - 1))];
    }
    measure_changes(one);
    return {};
  }

  void measure_changes(OneSlice& one) const {
    MeshOptions options = options_.mesh;
    options.solid = nullptr;
    options.table = nullptr;
    SliceField segmented = slice_field(stack_, one.shown.index, options, one.shown.pixels);
    if (std::holds_alternative<Equalize>(options.segmentation)) {
      one.cut = std::numeric_limits<double>::infinity();
      const std::vector<float>& values = std::get<Image>(one.shown.pixels).values;
      for (std::size_t p = 0; p < values.size(); ++p) {
        if (segmented.field.image.values[p] >= segmented.field.iso)
          one.cut = std::min(one.cut, static_cast<double>(values[p]));
      }
    }
    for (const Change& change : out_.changes) {
      segmented.field.iso = static_cast<float>(change.threshold);
      const Pslg contours = contours_of(stack_, one.shown.index, options, segmented.field);
      one.areas.push_back(area_of(contours, options.lattice));
      one.outlines.push_back(contours.rings.size());
    }
  }

  void finish() {
    ValueTally tally;
    bool has_uncounted = false;
    out_.lowest_cut = std::numeric_limits<double>::infinity();
    out_.highest_cut = -out_.lowest_cut;
    for (OneSlice& one : slices_) {
      tally.add(one.tally);
      has_uncounted |= one.has_uncounted;
      for (std::size_t k = 0; k < one.areas.size(); ++k) {
        out_.changes[k].area_mm2 += one.areas[k];
        out_.changes[k].outlines += one.outlines[k];
      }
      for (std::size_t k = 0; k < one.counts.size(); ++k)
        out_.histogram.counts[k] += one.counts[k];
      for (const auto& [label, voxels] : one.label_voxels)
        out_.label_voxels[label] += voxels;
      if (std::isfinite(one.cut)) {
        out_.lowest_cut = std::min(out_.lowest_cut, one.cut);
        out_.highest_cut = std::max(out_.highest_cut, one.cut);
      }
      out_.shown.push_back(std::move(one.shown));
    }
    out_.lattice = options_.mesh.lattice;
    out_.crop = options_.mesh.crop.value_or(Crop{0, stack_.width() - 1, 0, stack_.height() - 1});
    out_.slices = stack_.size();
    out_.width = stack_.width();
    out_.height = stack_.height();
    if (stack_.size() > 1) {
      out_.step_mm = std::abs(stack_.plane(stack_.size() - 1).z_mm - stack_.plane(0).z_mm) /
                     (stack_.size() - 1);
    }
    out_.has_solid = options_.solid.any();
    out_.has_table = options_.mesh.table != nullptr && !options_.mesh.table->runs().empty();
    out_.is_filled = options_.solid.fill_mm2.has_value();
    out_.warnings = stack_.warnings;
    out_.warnings.insert(out_.warnings.end(), of_volume_.begin(), of_volume_.end());
    if (stack_.voxel_conflict) {
      out_.warnings.push_back({kVoxelVolume, input_name(stack_),
                               stack_.voxel_conflict->reason + "; the sform is used"});
    }
    if (has_uncounted) {
      out_.warnings.push_back({"labels_not_counted", input_name(stack_),
                               "a slice has more than " + std::to_string(kMaxLabelsCounted) +
                                   " labels; not all that are not wanted are counted"});
    }
    if (auto doubt = value_warning(tally, out_.unit, out_.segmentation, input_name(stack_)))
      out_.warnings.push_back(std::move(*doubt));
    if (auto rounded = rounding_warning(tally, input_name(stack_)))
      out_.warnings.push_back(std::move(*rounded));
    out_.warnings = grouped(out_.warnings);
  }

  const SliceStack& stack_;
  StackOptions options_;
  int first_ = 0, last_ = 0;
  std::vector<Warning> of_volume_;  // of the table and of solid bone
  std::vector<OneSlice> slices_;
  Preview out_;
};

// A sentence about how much of a bone is filled at the distance between the slices. The figures were
// measured on vertebrae and ribs with expert masks, and on phantoms between them.
std::string fill_text(const Preview& preview) {
  if (!preview.is_filled || preview.slices < 2) return "";
  return " With slices " + number_text(preview.step_mm, 2) +
         " mm apart, expect filled bone to cover " +
         (preview.step_mm <= 1.5  ? "94 to 98"
          : preview.step_mm < 2.5 ? "80 to 95"
                                  : "42 to 90") +
         " % of a vertebra or rib" +
         (preview.step_mm <= 1.5 ? "."
                                 : ", since thin walls fade; slices up to 1.5 mm apart give "
                                   "94 to 98 %.");
}

std::string solid_text(const SolidOptions& o) {
  std::string out;
  if (o.min_volume_mm3 > 0)
    out += "; components below " + number_text(o.min_volume_mm3) + " mm3 dropped";
  if (o.fill_mm2) {
    out += "; filled inside";
    if (std::isfinite(*o.fill_mm2)) out += " up to " + number_text(*o.fill_mm2) + " mm2";
    if (o.close_mm > 0) out += ", gaps up to " + number_text(2 * o.close_mm) + " mm closed";
  }
  if (o.column) out += "; spinal column alone";
  if (!o.mask_labels.empty()) out += "; within mask " + named_ranges("label", o.mask_labels);
  if (!o.seeds_lps_mm.empty()) {
    out += "; nearest to the first of " + std::to_string(o.seeds_lps_mm.size()) +
           (o.seeds_lps_mm.size() == 1 ? " seed" : " seeds");
  }
  if (o.largest > 0) out += "; largest " + std::to_string(o.largest);
  return out;
}

}  // namespace

Result<Preview> make_preview(const SliceStack& stack, const StackOptions& options, int count) {
  if (auto ok = check_ranges(stack, options); !ok) return ok.error();
  return Maker(stack, options).make(count);
}

std::string unit_name(const Preview& preview) {
  if (labels_of(preview.segmentation) != nullptr) return "labels";
  if (preview.unit == PixelUnit::kHounsfield) return "HU";
  return preview.unit == PixelUnit::kGrey ? "grey levels" : "values";
}

std::string slices_shown(const Preview& preview) {
  const std::size_t n = preview.shown.size();
  return n == 1 ? "the slice shown" : "the " + std::to_string(n) + " slices shown";
}

std::vector<Warning> shown_warnings(const Preview& preview) {
  // The sentences of these warnings contain only fixed words and numbers.
  static constexpr std::array kPlain = {
      "contrast_filled", "copied_slice",    "gantry_tilt",       "labels_not_counted",
      "localiser",       "looks_like_ct",   "looks_like_labels", "looks_offset",
      "missing_slice",   "no_modality",     "no_orientation",    "no_pixel_spacing",
      "no_rescale",      "no_series_uid",   "no_sop_uid",        "not_dicom",
      "spacing_ignored", "table_connected", "table_removed",     "threshold_out_of_range",
      "uneven_spacing",  "voxel_volume"};
  std::vector<Warning> out;
  for (const Warning& w : preview.warnings) {
    const bool is_plain = std::find(kPlain.begin(), kPlain.end(), w.code) != kPlain.end();
    const std::string sentence = is_plain ? w.sentence : "see the messages of the program";
    if (std::none_of(out.begin(), out.end(), [&](const Warning& other) {
          return other.code == w.code && other.sentence == sentence;
        }))
      out.push_back({w.code, "", sentence});
  }
  return out;
}

std::string changes_text(const Preview& preview) {
  return "Sums over " + slices_shown(preview) + ", of the contours before simplification" +
         (preview.has_solid ? " and without solid bone" : "") +
         (preview.has_table ? ", with the scanner's table." : ".") + fill_text(preview);
}

std::string number_text(double value, int digits) {
  char out[40];
  std::snprintf(out, sizeof out, "%.*g", digits, value);
  // A number with more digits is printed as an integer, not with an exponent.
  if (std::abs(value) >= std::pow(10.0, digits) && std::abs(value) < 1e15)
    std::snprintf(out, sizeof out, "%.0f", value);
  return out;
}

std::string size_text(const Preview& preview, const Crop& view) {
  const SlicePlane& plane = preview.shown[0].plane;
  const auto sides = [&](int width, int height) {
    return number_text(width * plane.spacing_u_mm) + " x " +
           number_text(height * plane.spacing_v_mm) + " mm";
  };
  std::string out =
      std::to_string(preview.slices) + (preview.slices == 1 ? " slice" : " slices") + " of " +
      std::to_string(preview.width) + " x " + std::to_string(preview.height) + " pixels of " +
      number_text(plane.spacing_u_mm) + " x " + number_text(plane.spacing_v_mm) + " mm";
  if (preview.slices > 1) out += ", " + number_text(preview.step_mm) + " mm apart";
  out += "; whole slice " + sides(preview.width, preview.height) + ", shown " +
         sides(view.x1 - view.x0 + 1, view.y1 - view.y0 + 1);
  if (preview.inspected > 0) {
    out += "; the first and the last slice with material were sought in " +
           std::to_string(preview.inspected) +
           " slices, so material in a few slices beyond them can be missing here";
  }
  return out;
}

std::string input_kind(const SliceStack& stack) {
  if (stack.series) return "DICOM";
  if (stack.pixel_unit() == PixelUnit::kGrey) return "images";
  return !stack.files.empty() && is_nrrd(stack.files[0]) ? "NRRD" : "NIfTI";
}

std::string sheet_title(const SliceStack& stack, const Preview& preview) {
  const std::string kind = input_kind(stack);
  return "Preview of " + (kind == "images" ? kind : "a " + kind + " scan") + ": " +
         std::to_string(preview.shown.size()) + " of " + std::to_string(preview.slices) +
         " slices" +
         (preview.unit == PixelUnit::kUncalibrated ? ", not a CT (values are not HU)" : "");
}

std::string options_text(const StackOptions& options, const OpenOptions& input, PixelUnit unit) {
  std::string out = "material: ";
  const MeshOptions& mesh = options.mesh;
  if (const auto* threshold = std::get_if<Threshold>(&mesh.segmentation)) {
    out += "at or above " + number_text(threshold->value, 6);
    if (unit == PixelUnit::kHounsfield) out += " HU";
  } else if (const auto* equalize = std::get_if<Equalize>(&mesh.segmentation)) {
    out += "at or above level " + number_text(equalize->level, 6) + " after equalisation";
  } else {
    const auto& labels = std::get<Labels>(mesh.segmentation);
    out += labels.all ? "all labels" : named_ranges("label", labels.labels);
  }
  if (mesh.contour == ContourKind::kPixel) out += "; pixel chains";
  out += solid_text(options.solid);
  if (mesh.min_region_mm2 > 0)
    out += "; regions below " + number_text(mesh.min_region_mm2) + " mm2 dropped";
  if (options.slices) {
    out += "; slices " + std::to_string(options.slices->first) + " to " +
           std::to_string(options.slices->second);
  }
  if (mesh.crop) {
    out += "; crop " + std::to_string(mesh.crop->x0) + ":" + std::to_string(mesh.crop->x1) + "," +
           std::to_string(mesh.crop->y0) + ":" + std::to_string(mesh.crop->y1);
  }
  if (input.axis && *input.axis != SliceAxis::kAxial)
    out += *input.axis == SliceAxis::kCoronal ? "; coronal slices" : "; sagittal slices";
  return out;
}

}  // namespace trocar::pipeline
