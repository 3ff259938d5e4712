// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_join.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "pipeline/read/stack_shape.h"

namespace trocar::pipeline {
namespace {

bool is_intact(const DicomSeries& s) {
  return !s.slices.empty() && s.unusable == 0 && s.localisers == 0;
}

// What must agree for two series to be parts of one scan.
struct Trait {
  const char* name;
  bool agree;
};

std::vector<Trait> compared(const DicomSeries& one, const DicomSeries& other) {
  const DicomFrame &a = one.slices[0], &b = other.slices[0];
  return {{"study", one.info.study_uid == other.info.study_uid},
          {"modality", one.content.name == other.content.name},
          {"size", same_size(a, b)},
          {"frame of reference", same_frame_of_reference(a, b)},
          {"orientation", same_orientation(a, b)},
          {"pixel spacing", same_spacing(a, b)},
          {"kind (ImageType)", one.info.image_type == other.info.image_type},
          {"kernel", one.info.kernel == other.info.kernel},
          {"description", one.info.description == other.info.description},
          {"slice thickness", std::abs(a.thickness_mm - b.thickness_mm) <= 1e-3}};
}

bool all_agree(const DicomSeries& one, const DicomSeries& other) {
  const auto traits = compared(one, other);
  return std::all_of(traits.begin(), traits.end(), [](const Trait& t) { return t.agree; });
}

// A part of a scan, and where it lies along the normal of its first slice.
struct Part {
  const DicomSeries* series = nullptr;
  double low_mm = 0, high_mm = 0;
  bool is_single() const { return high_mm - low_mm < 1e-3; }
};

// The origins of all slices, ascending along the normal and without those at the same height.
std::vector<Eigen::Vector3d> origins_of(const std::vector<Part>& parts,
                                        const Eigen::Vector3d& normal) {
  std::vector<Eigen::Vector3d> all, out;
  for (const Part& part : parts) {
    for (const DicomFrame& h : part.series->slices)
      all.push_back(h.position);
  }
  std::sort(all.begin(), all.end(), [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return normal.dot(a) < normal.dot(b);
  });
  for (const Eigen::Vector3d& p : all) {
    if (out.empty() || normal.dot(p - out.back()) >= 1e-3) out.push_back(p);
  }
  return out;
}

// Do the origins lie on one line, at distances that are equal or, with `may_lack`, multiples of the
// smallest one?
bool is_stack(const std::vector<Eigen::Vector3d>& origins, const Eigen::Vector3d& normal,
              double pixel_mm, bool may_lack) {
  constexpr double kTolerance = 0.05;  // of a distance between slices, or of a pixel
  const StackShape shape = stack_shape(origins, normal);
  if (shape.gaps_mm.empty()) return false;
  const double step = *std::min_element(shape.gaps_mm.begin(), shape.gaps_mm.end());
  const bool is_even = std::all_of(shape.gaps_mm.begin(), shape.gaps_mm.end(), [&](double gap) {
    const double steps = may_lack ? std::max(1.0, std::round(gap / step)) : 1;
    return std::abs(gap - steps * step) <= kTolerance * step * steps;
  });
  const Eigen::Vector3d way = origins.back() - origins.front();
  const bool is_line = std::all_of(origins.begin(), origins.end(), [&](const Eigen::Vector3d& p) {
    const double along = normal.dot(p - origins.front()) / normal.dot(way);
    return (p - origins.front() - along * way).norm() <= kTolerance * pixel_mm + 1e-3;
  });
  return is_even && is_line;
}

// `series` agree in all traits.
bool are_parts(const std::vector<const DicomSeries*>& series) {
  const DicomFrame& first = series[0]->slices[0];
  const Eigen::Vector3d normal = first.u.cross(first.v);
  std::vector<Part> parts;
  for (const DicomSeries* s : series) {
    Part part{s, normal.dot(s->slices[0].position), normal.dot(s->slices[0].position)};
    for (const DicomFrame& h : s->slices) {
      part.low_mm = std::min(part.low_mm, normal.dot(h.position));
      part.high_mm = std::max(part.high_mm, normal.dot(h.position));
    }
    parts.push_back(part);
  }
  const bool all_single =
      std::all_of(parts.begin(), parts.end(), [](const Part& p) { return p.is_single(); });
  const double pixel_mm = std::min(first.spacing_u_mm, first.spacing_v_mm);
  if (!is_stack(origins_of(parts, normal), normal, pixel_mm, all_single)) return false;
  if (all_single) return true;
  std::sort(parts.begin(), parts.end(),
            [](const Part& a, const Part& b) { return a.low_mm < b.low_mm; });
  for (std::size_t i = 1; i < parts.size(); ++i) {
    if (parts[i].low_mm - parts[i - 1].high_mm < 1e-3 ||
        parts[i].series->info.number != parts[0].series->info.number)
      return false;
  }
  return true;
}

// The indices of series that agree in all traits, in lists of at least two.
std::vector<std::vector<std::size_t>> alike(const std::vector<DicomSeries>& series) {
  std::map<std::vector<std::string>, std::vector<std::vector<std::size_t>>> groups;
  for (std::size_t i = 0; i < series.size(); ++i) {
    if (!is_intact(series[i])) continue;
    const SeriesInfo& info = series[i].info;
    auto& of_key = groups[{info.study_uid, series[i].slices[0].frame_of_reference, info.description,
                           info.kernel, info.image_type}];
    const auto at = std::find_if(of_key.begin(), of_key.end(), [&](const auto& group) {
      return all_agree(series[group[0]], series[i]);
    });
    if (at == of_key.end()) {
      of_key.push_back({i});
    } else {
      at->push_back(i);
    }
  }
  std::vector<std::vector<std::size_t>> out;
  for (auto& [key, of_key] : groups) {
    for (auto& group : of_key) {
      if (group.size() > 1) out.push_back(std::move(group));
    }
  }
  return out;
}

void append(DicomSeries& to, DicomSeries&& part) {
  if (to.joined_uids.empty()) to.joined_uids = {to.info.uid};
  to.joined_uids.push_back(part.info.uid);
  to.slices.insert(to.slices.end(), part.slices.begin(), part.slices.end());
  to.files.insert(to.files.end(), part.files.begin(), part.files.end());
  if (to.unusable == 0) to.problem = part.problem;
  to.unusable += part.unusable;
  to.broken += part.broken;
  part.files.clear();
}

bool is_broken_part(const DicomSeries& s, const DicomSeries& of) {
  return s.files.size() == 1 && s.broken == 1 && s.slices.empty() &&
         s.info.study_uid == of.info.study_uid && s.info.description == of.info.description &&
         s.info.modality == of.info.modality;
}

}  // namespace

void join_parts(std::vector<DicomSeries>& series) {
  for (const auto& group : alike(series)) {
    std::vector<const DicomSeries*> members;
    for (const std::size_t i : group)
      members.push_back(&series[i]);
    if (!are_parts(members)) continue;
    DicomSeries& first = series[group[0]];
    for (std::size_t k = 1; k < group.size(); ++k)
      append(first, std::move(series[group[k]]));
    for (DicomSeries& s : series) {
      if (is_broken_part(s, first)) append(first, std::move(s));
    }
  }
  std::erase_if(series, [](const DicomSeries& s) { return s.files.empty(); });
}

std::string why_not_joined(const std::vector<DicomSeries>& series, std::size_t index) {
  const DicomSeries& one = series[index];
  const auto is_single = [](const DicomSeries& s) { return is_intact(s) && s.slices.size() == 1; };
  if (!is_single(one)) return {};
  std::size_t count = 0;
  std::string reason;
  for (const DicomSeries& other : series) {
    if (&other == &one || !is_single(other)) continue;
    const auto traits = compared(one, other);
    constexpr std::ptrdiff_t kMustAgree = 3;  // study, modality and size
    const auto differs =
        std::find_if(traits.begin(), traits.end(), [](const Trait& t) { return !t.agree; });
    if (differs - traits.begin() < kMustAgree) continue;
    const std::string what = differs == traits.end()
                                 ? "positions, which do not form one evenly spaced stack"
                                 : std::string(differs->name);
    if (count++ == 0 || differs != traits.end()) reason = what;
  }
  return count < 2 ? std::string() : reason;
}

}  // namespace trocar::pipeline
