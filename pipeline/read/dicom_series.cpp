// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom_series.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

namespace trocar::pipeline {
namespace {

struct Series {
  std::vector<DicomFrame> slices;
  std::string problem;  // of its first unusable file
  std::size_t unusable = 0;
  std::size_t broken = 0;  // of those: what should have been slices
  std::string first_file;  // any, for messages
  // Broken slices count: a damaged scan is still chosen over a smaller series beside it.
  std::size_t images() const { return slices.size() + broken; }
};

std::string format_mm(double mm) {
  char out[32];
  std::snprintf(out, sizeof out, "%.4g", mm);
  return out;
}

// Used in place of a missing series UID; equal for images that may belong to one scan.
std::string substitute_uid(const DicomFile& file) {
  if (file.frames.empty()) return "(no UID)";
  const DicomFrame& h = file.frames[0];
  char rest[128];
  std::snprintf(rest, sizeof rest, ", %d x %d, %.3f %.3f %.3f %.3f %.3f %.3f)", h.columns, h.rows,
                h.u.x() + 0.0, h.u.y() + 0.0, h.u.z() + 0.0, h.v.x() + 0.0, h.v.y() + 0.0,
                h.v.z() + 0.0);
  return "(no UID, frame of reference '" + h.frame_of_reference + "'" + rest;
}

std::map<std::string, Series> group(const std::vector<DicomFile>& files,
                                    std::vector<Warning>& warnings) {
  std::map<std::string, Series> out;
  std::string without_series, without_sop;
  std::size_t series_count = 0, sop_count = 0;
  for (const DicomFile& file : files) {
    const std::string name = file.file.string();
    if (file.kind == DicomFile::Kind::kNotImage) {
      warnings.push_back({"not_dicom", name, "not a DICOM image; left out"});
      continue;
    }
    if (file.kind == DicomFile::Kind::kLocaliser) {
      warnings.push_back({"localiser", name, "a localiser; left out"});
      continue;
    }
    if (file.series_uid.empty()) {
      if (series_count++ == 0) without_series = name;
    }
    Series& series = out[file.series_uid.empty() ? substitute_uid(file) : file.series_uid];
    if (series.first_file.empty()) series.first_file = name;
    if (file.kind == DicomFile::Kind::kUnusable) {
      if (series.unusable++ == 0) series.problem = file.problem;
      const bool is_other = file.content.kind == ImageContent::Kind::kOther;
      if (!file.is_colour && !is_other) ++series.broken;
      continue;
    }
    if (file.frames[0].sop_uid.empty() && sop_count++ == 0) without_sop = name;
    series.slices.insert(series.slices.end(), file.frames.begin(), file.frames.end());
  }
  if (series_count > 0) {
    warnings.push_back({"no_series_uid", without_series,
                        std::to_string(series_count) +
                            " files have no SeriesInstanceUID (this is the first); they are "
                            "grouped by frame of reference, orientation and size"});
  }
  if (sop_count > 0) {
    warnings.push_back(
        {"no_sop_uid", without_sop,
         std::to_string(sop_count) + " files have no SOPInstanceUID (this is the first)"});
  }
  return out;
}

// Warns of gaps unlike the median and of shifts within the planes (a tilted gantry).
void warn_of_gaps(const std::vector<DicomFrame>& slices, const Eigen::Vector3d& normal,
                  std::vector<Warning>& warnings) {
  std::vector<double> gaps;
  double shift = 0;
  for (std::size_t i = 1; i < slices.size(); ++i) {
    const Eigen::Vector3d step = slices[i].position - slices[i - 1].position;
    gaps.push_back(normal.dot(step));
    shift = std::max(shift, (step - normal * normal.dot(step)).norm());
  }
  if (shift > 0.01) {
    warnings.push_back({"gantry_tilt", slices[0].name(),
                        "slices are shifted within their planes by up to " + format_mm(shift) +
                            " mm from one to the next; each keeps its position"});
  }
  if (gaps.size() < 2) return;
  std::vector<double> sorted = gaps;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  const double median = sorted[sorted.size() / 2];
  for (std::size_t i = 0; i < gaps.size(); ++i) {
    if (std::abs(gaps[i] - median) > 0.01 * median) {
      warnings.push_back({gaps[i] > 1.5 * median ? "missing_slice" : "uneven_spacing",
                          slices[i].name() + ", " + slices[i + 1].name(),
                          "a gap of " + format_mm(gaps[i]) + " mm between them, where " +
                              format_mm(median) +
                              " mm is the median; positions are kept as they are"});
    }
  }
}

// Without a rescale the stored values may be HU; if other slices of the series have one, they
// probably are not.
Result<void> check_rescale(const std::vector<DicomFrame>& slices, std::vector<Warning>& warnings) {
  const auto lacks = [](const DicomFrame& h) { return !h.has_rescale; };
  const auto first = std::find_if(slices.begin(), slices.end(), lacks);
  if (first == slices.end()) return {};
  const auto without = static_cast<std::size_t>(std::count_if(first, slices.end(), lacks));
  if (without < slices.size()) {
    return refused(first->name() + ": no rescale slope or intercept, which " +
                   std::to_string(slices.size() - without) + " of the series' " +
                   std::to_string(slices.size()) + " slices have");
  }
  warnings.push_back({"no_rescale", first->name(),
                      std::to_string(without) +
                          " slices lack a rescale slope or intercept (this is the first); 1 and 0 "
                          "are used, so that the stored values are taken as they are"});
  return {};
}

}  // namespace

Result<std::vector<DicomFrame>> choose_series(const std::vector<DicomFile>& files,
                                              const std::string& wanted, const std::string& where,
                                              std::vector<Warning>& warnings) {
  std::map<std::string, Series> series = group(files, warnings);
  if (series.empty()) {
    return refused(files.size() == 1
                       ? files[0].file.string() +
                             ": not a DICOM image, and its name is not that of a NIfTI (.nii, "
                             ".nii.gz) or an image (.png, .tif, .bmp, .jpg)"
                       : where + ": contains no DICOM images (" +
                             files[0].file.filename().string() + " is not one)");
  }
  auto chosen = series.begin();
  if (!wanted.empty()) {
    chosen = series.find(wanted);
    if (chosen == series.end()) {
      std::string have;
      for (const auto& [uid, s] : series)
        have += " " + uid + " (" + std::to_string(s.slices.size()) + ")";
      return usage("no series " + wanted + "; there are:" + have);
    }
  } else {
    for (auto it = series.begin(); it != series.end(); ++it) {
      if (it->second.images() > chosen->second.images()) chosen = it;
    }
    for (auto it = series.begin(); it != series.end(); ++it) {
      if (it == chosen) continue;
      const Series& s = it->second;
      warnings.push_back({"other_series", s.first_file,
                          "series '" + it->first + "' of " + std::to_string(s.slices.size()) +
                              " images was left out; choose it with --series" +
                              (s.unusable == 0 ? ""
                                               : " (it has " + std::to_string(s.unusable) +
                                                     " that cannot be used: " + s.problem + ")")});
    }
  }
  Series& out = chosen->second;
  if (out.unusable > 0) {
    return refused(out.problem +
                   (out.unusable == 1
                        ? ""
                        : " (and " + std::to_string(out.unusable - 1) + " more files like it)") +
                   (series.size() > 1 && wanted.empty() ? "; --series chooses another" : ""));
  }
  if (auto ok = check_rescale(out.slices, warnings); !ok) return ok.error();
  return std::move(out.slices);
}

Result<void> sort_and_check(std::vector<DicomFrame>& slices, std::vector<Warning>& warnings) {
  const DicomFrame first = slices[0];
  const Eigen::Vector3d normal = first.u.cross(first.v);
  for (const DicomFrame& h : slices) {
    const auto differs = [&](const char* what) {
      return refused(h.name() + ": its " + what + " differs from " + first.name() +
                     " of the same series");
    };
    if (h.rows != first.rows || h.columns != first.columns) return differs("size");
    if ((h.u - first.u).norm() > 1e-3 || (h.v - first.v).norm() > 1e-3)
      return differs("orientation");
    if (std::abs(h.spacing_u_mm - first.spacing_u_mm) > 1e-4 ||
        std::abs(h.spacing_v_mm - first.spacing_v_mm) > 1e-4)
      return differs("pixel spacing");
    if (!h.frame_of_reference.empty() && !first.frame_of_reference.empty() &&
        h.frame_of_reference != first.frame_of_reference)
      return differs("frame of reference");
  }
  std::stable_sort(slices.begin(), slices.end(),
                   [&normal](const DicomFrame& a, const DicomFrame& b) {
                     return normal.dot(a.position) < normal.dot(b.position);
                   });
  for (std::size_t i = 1; i < slices.size(); ++i) {
    const DicomFrame &a = slices[i - 1], &b = slices[i];
    if (normal.dot(b.position - a.position) < 1e-3) {
      const bool same = !a.sop_uid.empty() && a.sop_uid == b.sop_uid && a.frame == b.frame;
      return refused(b.name() + ": at the same position as " + a.name() +
                     (same ? ", and the same SOP instance" : ""));
    }
  }
  warn_of_gaps(slices, normal, warnings);
  return {};
}

}  // namespace trocar::pipeline
