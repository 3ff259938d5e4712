// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/dicom/modality.h"

#include <algorithm>
#include <array>
#include <initializer_list>
#include <span>
#include <string_view>
#include <utility>

#include "formats/asset/deidentification.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {
namespace {

using Names = std::pair<std::string_view, std::string_view>;

constexpr std::string_view kStorage = "1.2.840.10008.5.1.4.1.1.";

// SOP classes below kStorage: plain, enhanced and converted.
constexpr auto kModalityOfClass = std::to_array<Names>(
    {{"2", "CT"},      {"2.1", "CT"},        {"2.2", "CT"},      {"4", "MR"},     {"4.1", "MR"},
     {"4.3", "MR"},    {"4.4", "MR"},        {"128", "PT"},      {"128.1", "PT"}, {"130", "PT"},
     {"20", "NM"},     {"66.4", "SEG"},      {"6.1", "US"},      {"3.1", "US"},   {"6.2", "US"},
     {"1", "CR"},      {"1.1", "DX"},        {"1.2", "MG"},      {"12.1", "XA"},  {"12.2", "RF"},
     {"13.1.1", "XA"}, {"481.1", "RTIMAGE"}, {"481.2", "RTDOSE"}});

constexpr auto kWords = std::to_array<Names>({{"MR", "magnetic resonance"},
                                              {"PT", "positron emission tomography"},
                                              {"NM", "nuclear medicine"},
                                              {"SEG", "segmentation"},
                                              {"US", "ultrasound"},
                                              {"CR", "radiograph"},
                                              {"DX", "radiograph"},
                                              {"MG", "mammography"},
                                              {"XA", "angiography"},
                                              {"RF", "fluoroscopy"},
                                              {"RTIMAGE", "radiotherapy image"},
                                              {"RTDOSE", "radiotherapy dose"},
                                              {"SC", "secondary capture"},
                                              {"OT", "other"}});

std::string_view look_up(std::span<const Names> table, std::string_view key) {
  const auto found =
      std::find_if(table.begin(), table.end(), [key](const Names& n) { return n.first == key; });
  return found == table.end() ? std::string_view() : found->second;
}

// A code string for messages and files. DICOM allows 16 characters, but a file may hold any bytes.
std::string code_string(std::string text) {
  constexpr std::size_t kMax = 16;
  text.erase(0, std::min(text.find_first_not_of(' '), text.size()));
  text.erase(text.find_last_not_of(' ') + 1);
  if (text.size() > kMax) text.resize(kMax);
  for (char& c : text) {
    const bool is_allowed =
        (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == ' ';
    if (!is_allowed) c = '?';
  }
  return text;
}

std::string modality_of(DcmItem& data) {
  std::string out = code_string(dicom_text(&data, DCM_Modality));
  if (!out.empty()) return out;
  const std::string sop_class = dicom_text(&data, DCM_SOPClassUID);
  if (!sop_class.starts_with(kStorage)) return {};
  return std::string(
      look_up(kModalityOfClass, std::string_view(sop_class).substr(kStorage.size())));
}

// The first value of ImageType that contains one of the words.
std::string image_type_with(DcmItem& data, std::initializer_list<std::string_view> words) {
  OFString value;
  for (unsigned long i = 0; data.findAndGetOFString(DCM_ImageType, value, i).good(); ++i) {
    const std::string_view text(value.c_str(), value.size());
    if (std::any_of(words.begin(), words.end(), [text](std::string_view word) {
          return text.find(word) != std::string_view::npos;
        }))
      return code_string(std::string(text));
  }
  return {};
}

// The unit of a CT's values after the rescale if it is not HU: optical density, electron density,
// effective atomic number and others. (The RescaleType US means unspecified.)
std::string other_rescale(DcmItem& data) {
  OFString type;
  if (data.findAndGetOFString(DCM_RescaleType, type, 0, true).bad()) return {};
  const std::string known = code_string(type.c_str());
  return known.starts_with("HU") || known == "US" ? std::string() : known;
}

}  // namespace

ImageContent image_content(DcmItem& data) {
  using Kind = ImageContent::Kind;
  ImageContent out{Kind::kUnknown, modality_of(data)};
  const auto is = [&out](Kind kind, const std::string& type) {
    return ImageContent{kind, out.name + (out.name.empty() ? "" : " ") + type};
  };
  if (const auto scout = image_type_with(data, {"LOCALIZER", "SURVIEW", "SCOUT"}); !scout.empty())
    return is(Kind::kLocaliser, scout);
  if (const auto mosaic = image_type_with(data, {"MOSAIC"}); !mosaic.empty())
    return is(Kind::kOther, mosaic);
  // Pictures of a screen state the modality of what they show.
  const std::string sop_class = dicom_text(&data, DCM_SOPClassUID);
  const bool is_capture = sop_class == std::string(kStorage) + "7" ||
                          sop_class.starts_with(std::string(kStorage) + "7.");
  if (!image_type_with(data, {"SCREEN SAVE", "SCREEN_SAVE"}).empty() ||
      (is_capture && !data.tagExists(DCM_RescaleIntercept)))
    return is(Kind::kOther, "SECONDARY CAPTURE");
  if (const std::string type = other_rescale(data); out.name == "CT" && !type.empty())
    return is(Kind::kOther, type);
  if (!out.name.empty()) out.kind = out.name == "CT" ? Kind::kCt : Kind::kOther;
  return out;
}

std::string why_not_ct(const ImageContent& content) {
  constexpr const char* kAsItIs = ", or --any-modality to mesh it as it is";
  const std::string what = "its modality is " + content.name;
  if (content.kind == ImageContent::Kind::kLocaliser) {
    return "a localiser (" + content.name +
           "), a view for planning whose values are not HU; give the CT series" + kAsItIs;
  }
  if (content.name.find("MOSAIC") != std::string::npos) {
    return what + ", many slices side by side in one image, and its values are not HU; give a CT" +
           kAsItIs;
  }
  if (content.name.find("CAPTURE") != std::string::npos)
    return "a picture of a screen (" + content.name + "), not HU; give the CT series" + kAsItIs;
  if (content.name.starts_with("CT ")) {
    return "a CT whose values are not HU after the rescale (RescaleType " + content.name.substr(3) +
           "); give the series in HU" + kAsItIs;
  }
  const std::string_view words = look_up(kWords, content.name);
  const std::string named = what + (words.empty() ? "" : " (" + std::string(words) + ")");
  if (content.is_segmentation())
    return named + ", not HU; mesh its segments with --labels N, or --labels all";
  return named + ", so its values are not HU; give a CT" + kAsItIs;
}

Result<void> settle_localisers(std::vector<DicomFile>& files, const std::string& wanted,
                               bool any_modality) {
  using Kind = DicomFile::Kind;
  DicomFile* first = nullptr;
  for (DicomFile& file : files) {
    if (!wanted.empty() && file.series.uid != wanted) continue;
    if (file.kind != Kind::kLocaliser && file.kind != Kind::kNotImage) return {};
    if (file.kind == Kind::kLocaliser && first == nullptr) first = &file;
  }
  if (first == nullptr) return {};
  if (!any_modality) return refused(first->problem);
  for (DicomFile& file : files) {
    if (file.kind == Kind::kLocaliser && (wanted.empty() || file.series.uid == wanted))
      file.kind = file.frames.empty() ? Kind::kUnusable : Kind::kImages;
  }
  return {};
}

std::string other_modality(const std::vector<DicomFile>& files,
                           const std::set<std::filesystem::path>& used,
                           std::vector<Warning>& warnings) {
  const DicomFile *other = nullptr, *unknown = nullptr;
  for (const DicomFile& file : files) {
    if (used.count(file.file) == 0 || file.content.kind == ImageContent::Kind::kCt) continue;
    const bool is_unknown = file.content.kind == ImageContent::Kind::kUnknown;
    const DicomFile*& which = is_unknown ? unknown : other;
    if (which == nullptr) which = &file;
  }
  if (other != nullptr) {
    const auto sentence = [](const std::string& name) {
      return "values are not HU: these images are " + name + "; no mean HU is stored";
    };
    warnings.push_back({"not_hu", other->file.string(), sentence(other->content.name),
                        sentence(shared_modality(other->content.name))});
    return other->content.name;
  }
  if (unknown != nullptr) {
    warnings.push_back({"no_modality", unknown->file.string(),
                        "no modality is given; the values are taken as HU of a CT"});
  }
  return {};
}

}  // namespace trocar::pipeline
