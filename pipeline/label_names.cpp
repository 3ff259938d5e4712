// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/label_names.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <initializer_list>
#include <optional>
#include <string_view>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/base/strict_json.h"

namespace trocar::pipeline {
namespace {

constexpr std::uint64_t kMaxFile_bytes = 1 << 20;
constexpr std::size_t kMaxName_bytes = 64;
constexpr int kMaxLabel = 1'000'000'000;  // as segment()

// Numbers one part after the other: the next label gets the next name.
struct Numbering {
  LabelNames names;
  int next = 1;

  void add(std::string name) { names.emplace(next++, std::move(name)); }
  void add(const std::string& name, int first, int last) {
    for (int i = first; i != last; i += first < last ? 1 : -1)
      add(name + std::to_string(i));
    add(name + std::to_string(last));
  }
};

LabelNames make_verse_names() {
  Numbering out;
  out.add("C", 1, 7);
  out.add("T", 1, 12);
  out.add("L", 1, 6);
  out.add("sacrum");
  out.add("coccyx");
  out.add("T13");
  return out.names;
}

LabelNames make_totalsegmentator_names() {
  constexpr std::array kSoftOrgans = {
      "spleen",
      "kidney_right",
      "kidney_left",
      "gallbladder",
      "liver",
      "stomach",
      "pancreas",
      "adrenal_gland_right",
      "adrenal_gland_left",
      "lung_upper_lobe_left",
      "lung_lower_lobe_left",
      "lung_upper_lobe_right",
      "lung_middle_lobe_right",
      "lung_lower_lobe_right",
      "esophagus",
      "trachea",
      "thyroid_gland",
      "small_bowel",
      "duodenum",
      "colon",
      "urinary_bladder",
      "prostate",
      "kidney_cyst_left",
      "kidney_cyst_right",
  };
  constexpr std::array kVessels = {
      "heart",
      "aorta",
      "pulmonary_vein",
      "brachiocephalic_trunk",
      "subclavian_artery_right",
      "subclavian_artery_left",
      "common_carotid_artery_right",
      "common_carotid_artery_left",
      "brachiocephalic_vein_left",
      "brachiocephalic_vein_right",
      "atrial_appendage_left",
      "superior_vena_cava",
      "inferior_vena_cava",
      "portal_vein_and_splenic_vein",
  };
  Numbering out;
  for (const char* name : kSoftOrgans)
    out.add(name);
  out.add("sacrum");
  out.add("vertebrae_S1");
  out.add("vertebrae_L", 5, 1);
  out.add("vertebrae_T", 12, 1);
  out.add("vertebrae_C", 7, 1);
  for (const char* name : kVessels)
    out.add(name);
  const auto add_pairs = [&out](std::initializer_list<const char*> names) {
    for (const std::string name : names) {
      out.add(name + "_left");
      out.add(name + "_right");
    }
  };
  add_pairs({"iliac_artery", "iliac_vena", "humerus", "scapula", "clavicula", "femur", "hip"});
  out.add("spinal_cord");
  add_pairs({"gluteus_maximus", "gluteus_medius", "gluteus_minimus", "autochthon", "iliopsoas"});
  out.add("brain");
  out.add("skull");
  out.add("rib_left_", 1, 12);
  out.add("rib_right_", 1, 12);
  out.add("sternum");
  out.add("costal_cartilages");
  return out.names;
}

std::optional<int> label_of(const std::string& text) {
  int label = 0;
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, label);
  const bool is_label = error == std::errc() && at == end && label != 0 && label < kMaxLabel &&
                        label > -kMaxLabel && std::to_string(label) == text;
  return is_label ? std::optional(label) : std::nullopt;
}

// The parser has seen that it is UTF-8.
bool is_name(const std::string& text) {
  return !text.empty() && text.size() <= kMaxName_bytes &&
         std::none_of(text.begin(), text.end(),
                      [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

}  // namespace

const LabelNames& verse_names() {
  static const LabelNames kNames = make_verse_names();
  return kNames;
}

const LabelNames& totalsegmentator_names() {
  static const LabelNames kNames = make_totalsegmentator_names();
  return kNames;
}

Result<LabelNames> read_label_names(const std::string& table_or_file) {
  if (table_or_file == "verse") return verse_names();
  if (table_or_file == "totalsegmentator") return totalsegmentator_names();
  const auto bytes = read_file(table_or_file, kMaxFile_bytes);
  if (!bytes) return bytes.error();
  const std::string text(bytes->begin(), bytes->end());
  const auto json = parse_strict_json(text, table_or_file);
  if (!json) return json.error();
  if (!json->is_object() || json->empty())
    return refused(table_or_file + ": must be an object of labels and names, as {\"22\": \"L3\"}");
  LabelNames out;
  for (const auto& [key, value] : json->items()) {
    const std::string what = table_or_file + ": /" + nlohmann::json(key).dump();
    const std::optional<int> label = label_of(key);
    if (!label) return refused(what + ": must be a label: a whole number, not 0, below 1e9");
    if (!value.is_string() || !is_name(value.get_ref<const std::string&>())) {
      return refused(what + ": must be a name of 1 to " + std::to_string(kMaxName_bytes) +
                     " bytes without control characters");
    }
    out.emplace(*label, value.get<std::string>());
  }
  return out;
}

std::vector<NamedMaterial> named_materials(const std::set<int>& wanted, const LabelNames& names) {
  std::vector<NamedMaterial> out;
  std::map<std::string, std::size_t> places;
  for (const int label : wanted) {
    const auto it = names.find(label);
    const std::string name = it != names.end() ? it->second : "label " + std::to_string(label);
    const auto [place, is_new] = places.emplace(name, out.size());
    if (is_new) out.push_back({name, {}});
    out[place->second].labels.labels.insert(label);
  }
  return out;
}

}  // namespace trocar::pipeline
