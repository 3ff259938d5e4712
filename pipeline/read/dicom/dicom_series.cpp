// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/dicom_series.h"

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <iterator>

#include "formats/asset/deidentification.h"
#include "pipeline/read/file_names.h"

namespace trocar::pipeline {
namespace {

// A text that replaces a missing series UID. Images that may belong to one scan get the same text.
std::string substitute_uid(const DicomFile& file) {
  if (file.frames.empty()) return "(no UID)";
  const DicomFrame& h = file.frames[0];
  char rest[128];
  std::snprintf(rest, sizeof rest, ", %d x %d, %.3f %.3f %.3f %.3f %.3f %.3f)", h.columns, h.rows,
                h.u.x() + 0.0, h.u.y() + 0.0, h.u.z() + 0.0, h.v.x() + 0.0, h.v.y() + 0.0,
                h.v.z() + 0.0);
  return "(no UID, frame of reference '" + h.frame_of_reference + "'" + rest;
}

std::string plural(std::size_t n, const char* what) {
  return std::to_string(n) + " " + what + (n == 1 ? "" : "s");
}

// The name of a series with its modality and number of files in brackets.
std::string description(const DicomSeries& s) {
  if (s.is_localiser()) return "localiser";
  const std::string modality = s.info.modality.empty() ? "" : s.info.modality + ", ";
  if (s.unusable > 0) return modality + plural(s.unusable, "unusable file") + ": " + s.problem;
  return modality + plural(s.slices.size(), "slice");
}

// The name of a series in messages, such as "3 'Bone H60s'"; its UID if it has neither number nor
// description.
std::string series_name(const SeriesInfo& series) {
  if (!series.number && series.description.empty()) return series.uid;
  std::string number = series.number ? std::to_string(*series.number) : "";
  if (series.description.empty()) return number;
  return number + (number.empty() ? "'" : " '") + series.description + "'";
}

std::string name_and_description(const DicomSeries& s) {
  return series_name(s.info) + " (" + description(s) + ")";
}

// The name of a series in reports, which must not identify the patient.
std::string shared_name(const DicomSeries& s) {
  return s.info.number ? std::to_string(*s.info.number) : "without number";
}
std::string shared_description(const DicomSeries& s) {
  return shared_name(s) + " (" + (is_modality(s.info.modality) ? s.info.modality : "other") + ", " +
         plural(s.slices.size() + s.unusable, "file") + ")";
}

// Lists the first eight series by their `text`, and the number of the others.
std::string listed(const std::vector<const DicomSeries*>& series,
                   std::string (*text)(const DicomSeries&)) {
  constexpr std::size_t kMax = 8;
  std::string out;
  for (std::size_t i = 0; i < std::min(series.size(), kMax); ++i)
    out += (i == 0 ? "" : ", ") + text(*series[i]);
  if (series.size() > kMax)
    out += " and " + std::to_string(series.size() - kMax) + " more, see trocar-mesh list";
  return out;
}

// The names of the series, each with its UID if another one has the same number or name.
std::string distinct_names(const std::vector<const DicomSeries*>& series) {
  std::string out;
  for (const DicomSeries* s : series) {
    const std::string name = series_name(s->info);
    const auto alike = std::count_if(series.begin(), series.end(), [&](const DicomSeries* other) {
      return series_name(other->info) == name ||
             (s->info.number && other->info.number == s->info.number);
    });
    out += (out.empty() ? "" : ", ") + name;
    if (alike > 1 && name != s->info.uid) out += " (" + s->info.uid + ")";
  }
  return out;
}

std::vector<const DicomSeries*> pointers(const std::vector<DicomSeries>& series) {
  std::vector<const DicomSeries*> out;
  out.reserve(series.size());
  for (const DicomSeries& s : series)
    out.push_back(&s);
  return out;
}

// The series that `wanted` names.
std::vector<const DicomSeries*> matches(const std::vector<DicomSeries>& series,
                                        const std::string& wanted) {
  std::vector<const DicomSeries*> out;
  for (const DicomSeries& s : series) {
    if (s.info.uid == wanted || std::count(s.joined_uids.begin(), s.joined_uids.end(), wanted) > 0)
      out.push_back(&s);
  }
  if (!out.empty()) return out;
  const auto add = [&](auto is_it) {
    for (const DicomSeries& s : series) {
      if (is_it(s.info)) out.push_back(&s);
    }
    return !out.empty();
  };
  int number = 0;
  const char* const end = wanted.data() + wanted.size();
  const auto [rest, error] = std::from_chars(wanted.data(), end, number);
  const bool is_number = error == std::errc() && rest == end;
  if (is_number && add([&](const SeriesInfo& s) { return s.number == number; })) return out;
  if (add([&](const SeriesInfo& s) { return s.description == wanted; })) return out;
  // A number must not match descriptions such as "Thorax 3.0".
  if (!is_number) {
    add([&](const SeriesInfo& s) {
      return lower(s.description).find(lower(wanted)) != std::string::npos;
    });
  }
  return out;
}

// The rank of a series. Series of lower rank are preferred.
int rank(const DicomSeries& s) {
  if (s.content.kind == ImageContent::Kind::kCt) return 0;
  return s.content.kind == ImageContent::Kind::kUnknown ? 1 : 2;
}

// The reason for choosing `best`. `candidates` are the series of `all` that have slices.
std::string why_chosen(const std::vector<const DicomSeries*>& all,
                       const std::vector<const DicomSeries*>& candidates, const DicomSeries& best) {
  const auto alike = std::count_if(candidates.begin(), candidates.end(),
                                   [&best](const auto* s) { return rank(*s) == rank(best); });
  const auto equal = std::count_if(candidates.begin(), candidates.end(), [&best](const auto* s) {
    return rank(*s) == rank(best) && s->images() == best.images();
  });
  const bool is_ct = rank(best) == 0;
  const std::string what = is_ct ? " CT series" : " series";
  if (equal > 1) {
    return std::string("the ") + (best.info.number ? "lowest number" : "first UID") + " of the " +
           std::to_string(equal) + what + " with most slices";
  }
  if (alike > 1) return "most slices of the " + std::to_string(alike) + what;
  const bool has_others = std::any_of(
      all.begin(), all.end(), [](const auto* s) { return !s->is_localiser() && rank(*s) == 2; });
  if (is_ct && has_others) return "the only CT series";
  return candidates.size() == 1 ? "the only one with slices" : "the only one that may be CT";
}

// Stored values without a rescale may be HU, but probably are not if other slices of the series
// have a rescale.
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
    if (at == of_key.end())
      of_key.push_back({i});
    else
      at->push_back(i);
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

// Joins the parts of scans, as group_series() describes. A joined series takes the place of its
// first part. A broken file that is alone in its series and has the same study, description and
// modality becomes a part, too, so that the scan is not taken without it.
void join_parts(std::vector<DicomSeries>& series) {
  for (const auto& group : alike(series)) {
    std::vector<const DicomSeries*> members;
    members.reserve(group.size());
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

// If series[index] has a single slice, and at least two other series of its study and size have,
// too: the attribute in which they differ, or what else keeps them from being joined. Otherwise
// empty.
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

}  // namespace

std::vector<DicomSeries> group_series(const std::vector<DicomFile>& files,
                                      std::vector<Warning>& warnings) {
  std::map<std::string, DicomSeries> by_uid;
  std::string without_series, without_sop;
  std::size_t series_count = 0, sop_count = 0;
  for (const DicomFile& file : files) {
    const std::string name = file.file.string();
    if (file.kind == DicomFile::Kind::kNotImage) {
      if (!is_left_by_system(file.file))
        warnings.push_back({"not_dicom", name, "not a DICOM image; left out"});
      continue;
    }
    const bool is_localiser = file.kind == DicomFile::Kind::kLocaliser;
    if (file.series.uid.empty() && !is_localiser) {
      if (series_count++ == 0) without_series = name;
    }
    const std::string uid = file.series.uid.empty() ? substitute_uid(file) : file.series.uid;
    DicomSeries& series = by_uid[uid];
    // The attributes of a slice replace those of a localiser.
    if (series.files.empty() || (!is_localiser && series.is_localiser())) {
      series.info = file.series;
      series.info.uid = uid;
      series.content = file.content;
    }
    series.files.push_back(file.file);
    if (is_localiser) {
      warnings.push_back({"localiser", name, "a localiser; left out"});
      ++series.localisers;
      continue;
    }
    if (file.kind == DicomFile::Kind::kUnusable || file.kind == DicomFile::Kind::kSegmentation) {
      if (series.unusable++ == 0) series.problem = file.problem;
      const bool is_other = file.content.kind == ImageContent::Kind::kOther;
      if (!file.is_capture && !is_other) ++series.broken;
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
  std::vector<DicomSeries> out;
  out.reserve(by_uid.size());
  for (auto& [uid, series] : by_uid)
    out.push_back(std::move(series));
  std::stable_sort(out.begin(), out.end(), [](const DicomSeries& a, const DicomSeries& b) {
    constexpr int kLast = std::numeric_limits<int>::max();
    return a.info.number.value_or(kLast) < b.info.number.value_or(kLast);
  });
  join_parts(out);
  return out;
}

Result<std::string> named_series(const std::vector<DicomSeries>& series,
                                 const std::string& wanted) {
  const auto named_so = matches(series, wanted);
  if (named_so.empty())
    return usage("no series " + wanted +
                 "; there are: " + listed(pointers(series), name_and_description));
  if (named_so.size() > 1) {
    const bool by_number = std::all_of(named_so.begin(), named_so.end(), [&](const auto* s) {
      return s->info.number && std::to_string(*s->info.number) == wanted;
    });
    std::set<std::string> studies;
    for (const DicomSeries* s : named_so)
      studies.insert(s->info.study_uid);
    const std::string of_studies =
        studies.size() == 1 ? "" : " of " + std::to_string(studies.size()) + " studies";
    return usage("--series " + wanted + " names " + std::to_string(named_so.size()) + " series" +
                 of_studies + ": " + distinct_names(named_so) +
                 (by_number ? "; give the UID of one" : "; give the number or UID of one"));
  }
  return named_so[0]->info.uid;
}

Result<ChosenSeries> choose_series(const std::vector<DicomSeries>& series, const std::string& uid,
                                   const std::string& where) {
  const auto all = pointers(series);
  if (!uid.empty()) {
    const auto chosen = std::find_if(series.begin(), series.end(),
                                     [&uid](const DicomSeries& s) { return s.info.uid == uid; });
    if (chosen == series.end()) return bug("no series " + uid);
    if (chosen->is_localiser())
      return refused(where + ": series " + series_name(chosen->info) + " is a localiser");
    return ChosenSeries{static_cast<std::size_t>(chosen - series.begin()), {}};
  }
  std::vector<const DicomSeries*> candidates;
  std::copy_if(all.begin(), all.end(), std::back_inserter(candidates),
               [](const DicomSeries* s) { return s->images() > 0; });
  if (candidates.empty()) {  // captures, or localisers only
    const auto other = std::find_if_not(all.begin(), all.end(),
                                        [](const DicomSeries* s) { return s->is_localiser(); });
    if (other == all.end()) {
      return refused(where + ": contains no slices, only " +
                     (all.size() == 1 ? "the localiser " : "localisers, the first ") +
                     series_name(all[0]->info));
    }
    candidates = {*other};
  }
  const auto best = *std::min_element(
      candidates.begin(), candidates.end(), [](const DicomSeries* a, const DicomSeries* b) {
        return std::pair(rank(*a), b->images()) < std::pair(rank(*b), a->images());
      });
  const auto index = static_cast<std::size_t>(best - series.data());
  if (const std::string reason = why_not_joined(series, index); !reason.empty()) {
    return refused(where +
                   ": its series have a single slice each; they are not joined, because they "
                   "differ in " +
                   reason + "; --series chooses one");
  }
  const std::string why = series.size() == 1 ? "" : why_chosen(all, candidates, *best);
  return ChosenSeries{index, why};
}

Result<std::vector<DicomFrame>> slices_of(const std::vector<DicomSeries>& series,
                                          const ChosenSeries& chosen, const std::string& where,
                                          std::vector<Warning>& warnings) {
  const DicomSeries& out = series[chosen.index];
  std::vector<const DicomSeries*> others = pointers(series);
  std::erase_if(others, [&out](const DicomSeries* s) { return s == &out || s->is_localiser(); });
  if (!chosen.why.empty() && !others.empty()) {
    std::set<std::string> studies = {out.info.study_uid};
    for (const DicomSeries* s : others)
      studies.insert(s->info.study_uid);
    const auto said = [&](const std::string& name, const std::string& left_out) {
      return "series " + name + " was taken (" + chosen.why + ", " +
             plural(out.slices.size(), "slice") + "); left out: " + left_out +
             (studies.size() == 1
                  ? ""
                  : "; they are of " + std::to_string(studies.size()) + " studies") +
             "; choose with --series";
    };
    warnings.push_back({"other_series", where,
                        said(series_name(out.info), listed(others, name_and_description)),
                        said(shared_name(out), listed(others, shared_description))});
  }
  if (out.unusable > 0) {
    return refused(out.problem +
                   (out.unusable == 1
                        ? ""
                        : " (and " + std::to_string(out.unusable - 1) + " more files like it)") +
                   (chosen.why.empty() ? "" : "; --series chooses another"));
  }
  if (!out.joined_uids.empty()) {
    warnings.push_back(
        {"joined_series", where,
         std::to_string(out.joined_uids.size()) + " series are joined to one scan of " +
             plural(out.slices.size(), "slice") +
             ": their study, frame of reference, orientation, grid of pixels and modality agree, "
             "and their slices form one stack"});
  }
  if (auto ok = check_rescale(out.slices, warnings); !ok) return ok.error();
  return out.slices;
}
}  // namespace trocar::pipeline
