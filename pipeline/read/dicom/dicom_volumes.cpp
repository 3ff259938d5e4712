// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_volumes.h"

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <numbers>
#include <tuple>

#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/dicom/dicom_pixels.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

std::string slices_text(std::size_t n) {
  return std::to_string(n) + (n == 1 ? " slice" : " slices");
}

bool have_equal_bytes(const std::filesystem::path& a, const std::filesystem::path& b) {
  if (a == b) return false;  // one file twice in a list
  const auto first = digest_file(a), second = digest_file(b);
  return first && second && *first == *second;
}

// Compares the pixels of frames. The last two files stay parsed: if a file were parsed for each of
// its frames, the time would be quadratic in their number.
class FrameComparison {
 public:
  bool are_equal(const DicomFrame& a, const DicomFrame& b) {
    // Two files of many frames are not compared by their bytes, which would be read anew for each.
    return (a.frames == 1 && have_equal_bytes(a.file, b.file)) || have_equal_pixels(a, b);
  }

 private:
  struct Parsed {
    std::filesystem::path file;
    std::unique_ptr<DcmFileFormat> format;
  };

  bool have_equal_pixels(const DicomFrame& a, const DicomFrame& b) {
    const auto first = read(a), second = read(b);
    return first && second && first->values == second->values;
  }

  std::optional<Image> read(const DicomFrame& h) {
    if (last_[0].file != h.file) std::swap(last_[0], last_[1]);
    if (last_[0].file != h.file) {
      last_[0] = {h.file, std::make_unique<DcmFileFormat>()};
      if (load_dicom(h.file, *last_[0].format).bad()) {
        last_[0] = {};
        return std::nullopt;
      }
    }
    auto image = read_dicom_frame(h, *last_[0].format);
    return image ? std::optional(std::move(*image)) : std::nullopt;
  }

  std::array<Parsed, 2> last_;
};

using Same = bool (*)(const DicomFrame&, const DicomFrame&);

// Divides frames into the largest group of those that are the same, and all others.
struct Majority {
  std::vector<DicomFrame> most, odd;
};

Majority majority(const std::vector<DicomFrame>& slices, Same same) {
  std::vector<std::pair<std::size_t, std::size_t>> groups;  // first member, number of members
  std::vector<std::size_t> group_of;
  for (const DicomFrame& h : slices) {
    const auto at = std::find_if(groups.begin(), groups.end(),
                                 [&](const auto& group) { return same(slices[group.first], h); });
    group_of.push_back(static_cast<std::size_t>(at - groups.begin()));
    if (at == groups.end()) groups.emplace_back(group_of.size() - 1, 0);
    ++groups[group_of.back()].second;
  }
  if (groups.empty()) return {};
  const auto largest =
      std::max_element(groups.begin(), groups.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  Majority out;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const bool is_most = group_of[i] == static_cast<std::size_t>(largest - groups.begin());
    (is_most ? out.most : out.odd).push_back(slices[i]);
  }
  return out;
}

void sort_along_normal(std::vector<DicomFrame>& slices) {
  const Eigen::Vector3d normal = slices[0].u.cross(slices[0].v);
  std::stable_sort(slices.begin(), slices.end(),
                   [&normal](const DicomFrame& a, const DicomFrame& b) {
                     return normal.dot(a.position) < normal.dot(b.position);
                   });
}

Error differs(const Majority& found, const std::string& what) {
  return refused(found.odd[0].name() + ": its " + what + " differs from " + found.most[0].name() +
                 " of the same series, as " + std::to_string(found.odd.size()) + " of " +
                 slices_text(found.odd.size() + found.most.size()) +
                 " do; to leave them out, give the other files by their names");
}

// May the odd slices be left out? They must be few and clearly turned, and no slice may be missing
// without them.
bool can_be_left_out(const Majority& found) {
  constexpr double kClearlyTurned = 0.17;  // the sine of 10 degrees
  if (4 * found.odd.size() >= found.odd.size() + found.most.size()) return false;
  const DicomFrame& first = found.most[0];
  const bool all_turned =
      std::all_of(found.odd.begin(), found.odd.end(), [&first](const DicomFrame& h) {
        return (h.u - first.u).norm() > kClearlyTurned || (h.v - first.v).norm() > kClearlyTurned;
      });
  std::vector<DicomFrame> sorted = found.most;
  sort_along_normal(sorted);
  const StackShape shape = stack_shape(sorted);
  return all_turned && std::all_of(shape.gaps_mm.begin(), shape.gaps_mm.end(),
                                   [&](double gap) { return gap <= 1.5 * shape.step_mm; });
}

// Returns the slices of the most frequent orientation.
Result<std::vector<DicomFrame>> of_one_grid(std::vector<DicomFrame> slices,
                                            std::vector<Warning>& warnings) {
  Majority found = majority(slices, same_orientation);
  if (!found.odd.empty()) {
    if (!can_be_left_out(found)) return differs(found, "orientation");
    for (const DicomFrame& h : found.odd) {
      warnings.push_back({"other_orientation", h.name(),
                          "its orientation differs from that of the " +
                              std::to_string(found.most.size()) +
                              " other slices of the series; left out"});
    }
    slices = std::move(found.most);
  }
  found = majority(slices, same_size);
  if (!found.odd.empty()) return differs(found, "size");
  found = majority(slices, same_spacing);
  if (!found.odd.empty()) return differs(found, "pixel spacing");
  std::vector<DicomFrame> referring;
  std::copy_if(slices.begin(), slices.end(), std::back_inserter(referring),
               [](const DicomFrame& h) { return !h.frame_of_reference.empty(); });
  found = majority(referring, same_frame_of_reference);
  if (!found.odd.empty()) return differs(found, "frame of reference");
  return slices;
}

// The slices at each position, ascending. `slices` are sorted.
using Positions = std::vector<std::vector<DicomFrame>>;

Positions positions_of(std::vector<DicomFrame> slices) {
  const Eigen::Vector3d normal = slices[0].u.cross(slices[0].v);
  // Positions are often rounded. No scan has slices that are so much closer than its pixels.
  const double same_mm =
      std::max(1e-3, 0.02 * std::min(slices[0].spacing_u_mm, slices[0].spacing_v_mm));
  Positions out;
  for (DicomFrame& h : slices) {
    if (out.empty() || normal.dot(h.position - out.back()[0].position) >= same_mm)
      out.emplace_back();
    out.back().push_back(std::move(h));
  }
  return out;
}

Error at_same_position(const DicomFrame& a, const DicomFrame& b) {
  const bool same = !a.sop_uid.empty() && a.sop_uid == b.sop_uid && a.frame == b.frame;
  return refused(b.name() + ": at the same position as " + a.name() +
                 (same ? ", and the same SOP instance with other pixels" : ""));
}

struct Copies {
  std::size_t count = 0;
  std::string first;
  void add(const DicomFrame& h) {
    if (count++ == 0) first = h.name();
  }
};

// Removes copies of slices that no attribute tells apart. Errors (refused) name two such slices with
// different pixels.
Result<void> remove_copies(Positions& positions, FrameComparison& comparison, Copies& copies) {
  for (std::vector<DicomFrame>& here : positions) {
    std::map<std::vector<std::string>, std::size_t> kept;  // volume values, index
    std::vector<DicomFrame> out;
    for (DicomFrame& h : here) {
      const auto [at, is_new] = kept.emplace(h.volume_values, out.size());
      if (is_new)
        out.push_back(std::move(h));
      else if (const DicomFrame& other = out[at->second]; comparison.are_equal(other, h))
        copies.add(h);
      else
        return at_same_position(other, h);
    }
    here = std::move(out);
  }
  return {};
}

// Two slices at the same position with different pixels; null if there are none.
std::pair<const DicomFrame*, const DicomFrame*> different_pair(const Positions& positions,
                                                               FrameComparison& comparison) {
  for (const std::vector<DicomFrame>& here : positions) {
    for (std::size_t i = 1; i < here.size(); ++i) {
      if (!comparison.are_equal(here[0], here[i])) return {&here[0], &here[i]};
    }
  }
  return {nullptr, nullptr};
}

// Numbers come before other texts, in ascending order. Dates and times are in order either way.
bool value_less(const std::string& a, const std::string& b) {
  const auto order = [](const std::string& text) {
    char* end = nullptr;
    const double number = std::strtod(text.c_str(), &end);
    const bool is_number = !text.empty() && *end == '\0' && std::isfinite(number);
    return std::tuple(!is_number, is_number ? number : 0, text);
  };
  return order(a) < order(b);
}

struct ValueLess {
  bool operator()(const std::string& a, const std::string& b) const { return value_less(a, b); }
};

std::size_t most_at_one_position(const Positions& positions) {
  std::size_t most = 0;
  for (const auto& here : positions)
    most = std::max(most, here.size());
  return most;
}

// One volume for each value of the attribute `key`; empty if two slices at one position have the
// same value, or if most values belong to one slice each, such as times of slices.
std::vector<DicomVolume> by_value(const Positions& positions, std::size_t key,
                                  const std::string& key_name) {
  std::map<std::string, DicomVolume, ValueLess> volumes;
  for (const auto& here : positions) {
    std::set<std::string, ValueLess> values;
    for (const DicomFrame& h : here) {
      const std::string& value = h.volume_values[key];
      if (!values.insert(value).second) return {};
      DicomVolume& volume = volumes[value];
      volume.slices.push_back(h);
      volume.name =
          value.empty() ? "without " + key_name : std::string(key_name).append(" ").append(value);
    }
  }
  const bool are_stacks = std::all_of(volumes.begin(), volumes.end(), [](const auto& volume) {
    return volume.second.slices.size() > 1;
  });
  if (volumes.size() < 2 || !(are_stacks || volumes.size() == most_at_one_position(positions)))
    return {};
  std::vector<DicomVolume> out;
  out.reserve(volumes.size());
  for (auto& [value, volume] : volumes)
    out.push_back(std::move(volume));
  return out;
}

// The first volume has the slice with the lowest value at each position, the second one the next,
// and so on. Empty if values are equal or missing, or if a volume's values begin before those of the
// volume before it end.
std::vector<DicomVolume> by_order(const Positions& positions, std::size_t key,
                                  const std::string& key_name) {
  std::vector<DicomVolume> out(most_at_one_position(positions));
  std::vector<std::pair<std::string, std::string>> ranges(out.size());
  for (const auto& here : positions) {
    std::map<std::string, const DicomFrame*, ValueLess> ordered;
    for (const DicomFrame& h : here)
      ordered.emplace(h.volume_values[key], &h);
    if (ordered.size() != here.size() || ordered.begin()->first.empty()) return {};
    std::size_t i = 0;
    for (const auto& [value, h] : ordered) {
      auto& [low, high] = ranges[i];
      if (low.empty() || value_less(value, low)) low = value;
      if (high.empty() || value_less(high, value)) high = value;
      out[i++].slices.push_back(*h);
    }
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    const auto& [low, high] = ranges[i];
    if (i > 0 && !value_less(ranges[i - 1].second, low)) return {};
    out[i].name = std::string(key_name).append(" ").append(low);
    if (low != high) out[i].name.append(" to ").append(high);
  }
  return out;
}

// Volumes by the attribute that gives fewest; empty if none tells all slices at one position apart.
std::vector<DicomVolume> divided(const Positions& positions) {
  const std::vector<DicomVolumeKey> keys = dicom_volume_keys();
  std::vector<DicomVolume> best;
  for (std::size_t key = 0; key < keys.size(); ++key) {
    auto volumes = by_value(positions, key, keys[key].name);
    if (!volumes.empty() && (best.empty() || volumes.size() < best.size()))
      best = std::move(volumes);
  }
  for (std::size_t key = 0; key < keys.size() && best.empty(); ++key)
    if (keys[key].is_of_slice) best = by_order(positions, key, keys[key].name);
  return best;
}

// Volumes at different times, of which the slices lie between each other; empty if there are none.
std::vector<DicomVolume> interleaved(const Positions& positions) {
  const std::vector<DicomVolumeKey> keys = dicom_volume_keys();
  const Eigen::Vector3d normal = positions[0][0].u.cross(positions[0][0].v);
  for (std::size_t key = 0; key < keys.size(); ++key) {
    if (!keys[key].is_of_volume) continue;
    auto volumes = by_value(positions, key, keys[key].name);
    std::vector<std::pair<double, double>> ranges;
    ranges.reserve(volumes.size());
    for (const DicomVolume& volume : volumes)
      ranges.emplace_back(normal.dot(volume.slices.front().position),
                          normal.dot(volume.slices.back().position));
    std::sort(ranges.begin(), ranges.end());
    for (std::size_t i = 1; i < ranges.size(); ++i)
      if (ranges[i].first < ranges[i - 1].second) return volumes;
  }
  return {};
}

// Warns of gaps that differ from the median and of shifts within the planes (a tilted gantry).
void warn_of_gaps(const std::vector<DicomFrame>& slices, std::vector<Warning>& warnings) {
  const StackShape shape = stack_shape(slices);
  if (shape.is_tilted()) {
    warnings.push_back({"gantry_tilt", slices[0].name(),
                        "slices are shifted within their planes by up to " +
                            text_of(shape.shift_mm, 4) +
                            " mm from one to the next; each keeps its position"});
  }
  for (std::size_t i = 0; i < shape.gaps_mm.size(); ++i) {
    const double gap = shape.gaps_mm[i];
    if (shape.is_uneven(i)) {
      warnings.push_back({gap > 1.5 * shape.step_mm ? "missing_slice" : "uneven_spacing",
                          slices[i].name() + ", " + slices[i + 1].name(),
                          "a gap of " + text_of(gap, 4) + " mm between them, where " +
                              text_of(shape.step_mm, 4) +
                              " mm is the median; positions are kept as they are"});
    }
  }
}

// Warns if the tilt of the slices' planes contradicts the gantry tilt that their headers state.
void warn_of_tilt(const std::vector<DicomFrame>& slices, std::vector<Warning>& warnings) {
  constexpr double kNearlyAxial = 0.7, kTolerance_deg = 1;
  const DicomFrame& h = slices[0];
  const double along_body = std::abs(h.u.cross(h.v).z());
  if (!h.stated_tilt_deg || along_body < kNearlyAxial) return;
  const double stated = std::abs(*h.stated_tilt_deg),
               found = std::acos(std::min(along_body, 1.0)) * 180 / std::numbers::pi;
  if (std::abs(stated - found) <= kTolerance_deg) return;
  warnings.push_back({"tilt_contradiction", h.name(),
                      "the gantry was tilted by " + text_of(stated, 3) +
                          " degrees (GantryDetectorTilt), but the planes are tilted by " +
                          text_of(found, 3) +
                          " (ImageOrientationPatient), which is used; unless the scanner corrected "
                          "the tilt, the shape is sheared"});
}

// Warns of padding that read_dicom_frame() replaces.
void warn_of_padding(const std::vector<DicomFrame>& slices, std::vector<Warning>& warnings) {
  const auto first = std::find_if(slices.begin(), slices.end(),
                                  [](const DicomFrame& h) { return h.has_dense_padding(); });
  if (first == slices.end()) return;
  const double low = first->hu((*first->padding)[0]), high = first->hu((*first->padding)[1]);
  warnings.push_back({"dense_padding", first->name(),
                      "pixels of " + text_of(low, 6) +
                          (low == high ? "" : " to " + text_of(high, 6)) +
                          " HU are declared to be without data (PixelPaddingValue); they are taken "
                          "as air"});
}

}  // namespace

Result<std::vector<DicomVolume>> volumes_of(std::vector<DicomFrame> slices,
                                            std::vector<Warning>& warnings) {
  auto of_grid = of_one_grid(std::move(slices), warnings);
  if (!of_grid) return of_grid.error();
  sort_along_normal(*of_grid);
  Positions positions = positions_of(std::move(*of_grid));
  FrameComparison comparison;
  Copies copies;
  if (auto ok = remove_copies(positions, comparison, copies); !ok) return ok.error();
  std::vector<DicomVolume> out;
  if (const auto [a, b] = different_pair(positions, comparison); a != nullptr) {
    out = divided(positions);
    if (out.empty()) return at_same_position(*a, *b);
  } else if (copies.count == 0 && most_at_one_position(positions) == 1) {
    out = interleaved(positions);
  }
  if (out.empty()) {
    out.emplace_back();
    for (std::vector<DicomFrame>& here : positions) {
      for (std::size_t i = 1; i < here.size(); ++i)
        copies.add(here[i]);
      out[0].slices.push_back(std::move(here[0]));
    }
  }
  if (copies.count > 0) {
    warnings.push_back({"copied_slice", copies.first,
                        slices_text(copies.count) + (copies.count == 1 ? " is" : " are") +
                            " there twice with equal pixels (this is the first); the copies are "
                            "left out"});
  }
  return out;
}

Result<void> check_no_volume(const std::string& where, std::optional<int> volume) {
  if (!volume) return {};
  return usage(
      where +
      ": --volume chooses among the volumes of a NIfTI or NRRD file, or of a DICOM series with "
      "several; this is none");
}

Result<std::size_t> chosen_volume(const std::vector<DicomVolume>& volumes,
                                  std::optional<int> wanted, const std::string& name) {
  if (volumes.size() == 1) {
    if (auto ok = check_no_volume(name, wanted); !ok) return ok.error();
    return std::size_t{0};
  }
  const std::string range = "0:" + std::to_string(volumes.size() - 1);
  if (wanted && *wanted >= 0 && static_cast<std::size_t>(*wanted) < volumes.size())
    return static_cast<std::size_t>(*wanted);
  if (wanted) return usage(name + ": --volume " + std::to_string(*wanted) + " is outside " + range);
  constexpr std::size_t kMax = 8;
  std::string text;
  for (std::size_t i = 0; i < std::min(volumes.size(), kMax); ++i) {
    text += (i == 0 ? "" : ", ") + std::to_string(i) + " (" + volumes[i].name + ", " +
            slices_text(volumes[i].slices.size()) + ")";
  }
  if (volumes.size() > kMax) text += " and more, see trocar-mesh list";
  return usage(name + ": holds " + std::to_string(volumes.size()) +
               " volumes at the same positions: " + text + "; choose one of " + range +
               " with --volume");
}

void warn_of_volume(const std::vector<DicomFrame>& slices, std::vector<Warning>& warnings) {
  warn_of_gaps(slices, warnings);
  warn_of_tilt(slices, warnings);
  warn_of_padding(slices, warnings);
}

StackShape stack_shape(const std::vector<DicomFrame>& slices) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(slices.size());
  for (const DicomFrame& slice : slices)
    positions.push_back(slice.position);
  return stack_shape(positions, slices[0].u.cross(slices[0].v));
}

}  // namespace trocar::pipeline
