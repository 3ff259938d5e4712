// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/bake/label_names.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <sstream>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

// The names of the labels 1, 2, ... of two data sets, with spaces between them.
// VerSe: Sekuboyina and others, Medical Image Analysis 73 (2021), and the challenge's page on
// labels.
constexpr const char* kVerse =
    "C1 C2 C3 C4 C5 C6 C7 T1 T2 T3 T4 T5 T6 T7 T8 T9 T10 T11 T12 L1 L2 L3 L4 L5 L6 sacrum coccyx "
    "T13";
// TotalSegmentator, version 2, task "total": Wasserthal and others, Radiology: AI 5 (2023).
constexpr const char* kTotalSegmentator =
    "spleen kidney_right kidney_left gallbladder liver stomach pancreas adrenal_gland_right "
    "adrenal_gland_left lung_upper_lobe_left lung_lower_lobe_left lung_upper_lobe_right "
    "lung_middle_lobe_right lung_lower_lobe_right esophagus trachea thyroid_gland small_bowel "
    "duodenum colon urinary_bladder prostate kidney_cyst_left kidney_cyst_right sacrum "
    "vertebrae_S1 vertebrae_L5 vertebrae_L4 vertebrae_L3 vertebrae_L2 vertebrae_L1 vertebrae_T12 "
    "vertebrae_T11 vertebrae_T10 vertebrae_T9 vertebrae_T8 vertebrae_T7 vertebrae_T6 vertebrae_T5 "
    "vertebrae_T4 vertebrae_T3 vertebrae_T2 vertebrae_T1 vertebrae_C7 vertebrae_C6 vertebrae_C5 "
    "vertebrae_C4 vertebrae_C3 vertebrae_C2 vertebrae_C1 heart aorta pulmonary_vein "
    "brachiocephalic_trunk subclavian_artery_right subclavian_artery_left "
    "common_carotid_artery_right common_carotid_artery_left brachiocephalic_vein_left "
    "brachiocephalic_vein_right atrial_appendage_left superior_vena_cava inferior_vena_cava "
    "portal_vein_and_splenic_vein iliac_artery_left iliac_artery_right iliac_vena_left "
    "iliac_vena_right humerus_left humerus_right scapula_left scapula_right clavicula_left "
    "clavicula_right femur_left femur_right hip_left hip_right spinal_cord gluteus_maximus_left "
    "gluteus_maximus_right gluteus_medius_left gluteus_medius_right gluteus_minimus_left "
    "gluteus_minimus_right autochthon_left autochthon_right iliopsoas_left iliopsoas_right brain "
    "skull rib_left_1 rib_left_2 rib_left_3 rib_left_4 rib_left_5 rib_left_6 rib_left_7 "
    "rib_left_8 rib_left_9 rib_left_10 rib_left_11 rib_left_12 rib_right_1 rib_right_2 "
    "rib_right_3 rib_right_4 rib_right_5 rib_right_6 rib_right_7 rib_right_8 rib_right_9 "
    "rib_right_10 rib_right_11 rib_right_12 sternum costal_cartilages";

// The reason why the text is not a valid name, if any.
std::optional<std::string> why_no_name(const std::string& text) {
  if (text.empty()) return "is empty";
  if (text.size() > kMaxNameBytes)
    return "has " + std::to_string(text.size()) + " bytes, at most " +
           std::to_string(kMaxNameBytes) + " are taken";
  if (text.front() == ' ' || text.back() == ' ') return "begins or ends with a space";
  for (std::size_t at = 0; at < text.size();) {
    const auto c = next_code_point(text, at);
    if (!c || !is_printable(*c)) return "has a character that cannot be printed";
  }
  return {};
}

// Makes a name from any bytes: those that cannot be printed become ?. Empty if nothing is left.
std::string as_name(const std::string& text) {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t from = at;
    const auto c = next_code_point(text, at);
    if (!c) ++at;
    const std::string shown = c && is_printable(*c) ? text.substr(from, at - from) : "?";
    if (out.size() + shown.size() > kMaxNameBytes) break;
    out += shown;
  }
  out.erase(0, std::min(out.find_first_not_of(' '), out.size()));
  out.erase(out.find_last_not_of(' ') + 1);
  return out;
}

// Reads a label, 1 to kMaxLabel, without sign or leading zeros.
std::optional<int> label_of(const std::string& text) {
  int out = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (error != std::errc() || end != text.data() + text.size() || out < 1 || text.front() == '0')
    return {};
  return out;
}

std::map<int, std::string> numbered(const char* names) {
  std::map<int, std::string> out;
  std::istringstream in(names);
  for (std::string name; in >> name;)
    out.emplace(static_cast<int>(out.size()) + 1, name);
  return out;
}

}  // namespace

Result<LabelNames> LabelNames::named(const std::string& what) {
  if (!is_table(what)) return of_file(what);
  LabelNames out;
  out.add_defaults(numbered(what == "verse" ? kVerse : kTotalSegmentator));
  return out;
}

Result<LabelNames> LabelNames::of_file(const std::string& file) {
  constexpr std::uint64_t kMaxBytes = 1 << 20;
  const auto bytes = read_file(file, kMaxBytes);
  if (!bytes)
    return Error{bytes.error().code,
                 bytes.error().message + " (--names takes a JSON file, verse or totalsegmentator)",
                 bytes.error().is_temporary};
  const auto text =
      parse_strict_json({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, file);
  if (!text) return text.error();
  if (!text->is_object() || text->empty())
    return refused(file + ": must be an object of labels and their names, as {\"20\": \"L1\"}");
  LabelNames out;
  for (const auto& [key, value] : text->items()) {
    const std::string where = file + ": " + json_text(json(key.substr(0, kMaxNameBytes))) + ": ";
    const auto label = label_of(key);
    if (!label) return refused(where + "is no label; labels are 1 to " + std::to_string(kMaxLabel));
    if (!value.is_string()) return refused(where + "its name must be a text");
    const auto name = value.get<std::string>();
    if (const auto wrong = why_no_name(name)) return refused(where + "its name " + *wrong);
    if (!out.add(*label, name))
      return refused(where + "another label is called " + json_text(json(name)) + ", too");
  }
  return out;
}

bool LabelNames::add(int label, const std::string& name) {
  if (!used_.insert(name).second) return false;
  names_.emplace(label, name);
  return true;
}

void LabelNames::add_defaults(const std::map<int, std::string>& of_input) {
  for (const auto& [label, text] : of_input) {
    const std::string name = as_name(text);
    if (!name.empty() && !names_.contains(label)) add(label, name);
  }
}

std::string LabelNames::name_of(int label) const {
  const auto found = names_.find(label);
  return found == names_.end() ? "label " + std::to_string(label) : found->second;
}

std::string LabelNames::list(const std::set<int>& labels) const {
  constexpr std::size_t kMax = 8;
  if (std::none_of(labels.begin(), labels.end(),
                   [this](int label) { return names_.contains(label); }))
    return named_ranges("label", labels);
  std::string out = labels.size() == 1 ? "label " : "labels ";
  std::size_t listed = 0;
  for (const int label : labels) {
    if (listed++ == kMax) return out + " and " + std::to_string(labels.size() - kMax) + " more";
    const auto found = names_.find(label);
    out += (listed == 1 ? "" : ", ") + std::to_string(label) +
           (found == names_.end() ? "" : " (" + found->second + ")");
  }
  return out;
}

}  // namespace trocar::pipeline
