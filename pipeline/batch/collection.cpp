// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/batch/collection.h"

#include <algorithm>
#include <map>
#include <set>
#include <system_error>
#include <unordered_map>

#include "formats/base/files.h"
#include "formats/base/json.h"
#include "formats/base/text.h"
#include "pipeline/batch/scan_files.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::size_t kMaxBytes = std::size_t{1} << 30;
constexpr std::size_t kMaxScans = 10'000'000;
constexpr std::size_t kMaxNameBytes = 120;
constexpr std::size_t kDigestBytes = 12;  // digits of a digest in a name

bool is_letter_or_digit(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
}

// Is the value a text for a path or a series: 1 to 4096 bytes without control characters?
bool is_text(const json& value) {
  if (!value.is_string()) return false;
  const auto& text = value.get_ref<const std::string&>();
  return !text.empty() && text.size() <= 4096 &&
         std::none_of(text.begin(), text.end(),
                      [](unsigned char c) { return c < 0x20 || c == 0x7f; });
}

bool is_value(const json& value) {
  if (value.is_array())
    return !value.empty() && std::all_of(value.begin(), value.end(), [](const json& one) {
      return one.is_number() || is_text(one);
    });
  return value.is_number() || value.is_boolean() || value.is_null() || is_text(value);
}

// Adds the given parameters to `into`. null and false remove a parameter from it.
void read_parameters(const json& given, const std::string& path, json& into, JsonErrors& errors) {
  if (!given.is_object()) return errors.add(path, "must be an object");
  for (const auto& [name, value] : given.items()) {
    if (!is_value(value)) {
      std::string at = path;
      errors.add(at.append("/").append(name),
                 "must be a number, a text, true, false, null, or an array");
    } else if (value.is_null() || value == false) {
      into.erase(name);
    } else {
      into[name] = value;
    }
  }
}

void read_input(const json& input, const std::string& path, CollectionScan& scan,
                JsonErrors& errors) {
  if (is_text(input)) {
    scan.paths = {input.get<std::string>()};
  } else if (input.is_array() && !input.empty() &&
             std::all_of(input.begin(), input.end(), is_text)) {
    scan.paths = input.get<std::vector<std::string>>();
  } else if (input.is_object() && input.contains("glob")) {
    StrictObject reader(input, path, errors);
    scan.glob = reader.string("glob");
    reader.finish();
  } else if (input.is_object()) {
    StrictObject reader(input, path, errors);
    scan.paths = {reader.string("folder")};
    if (const json* series = reader.optional_value("series"); series != nullptr) {
      if (series->is_number_integer())
        scan.series = json_text(*series);
      else if (is_text(*series))
        scan.series = series->get<std::string>();
      else
        errors.add(reader.path("series"), "must be a number or a text");
    }
    reader.finish();
  } else {
    errors.add(path, "must be a path, an array of paths, {\"glob\": ...} or {\"folder\": ...}");
  }
}

CollectionScan read_scan(const json& value, const std::string& path, const json& defaults,
                         JsonErrors& errors) {
  CollectionScan out;
  StrictObject reader(value, path, errors);
  out.name = reader.string("name");
  if (!out.name.empty() && !is_scan_name(out.name))
    errors.add(reader.path("name"),
               "must begin with a letter, digit or _, and hold only these and . + -, 120 at most");
  if (const json* input = reader.optional_value("input"); input == nullptr)
    errors.add(reader.path("input"), "is missing");
  else
    read_input(*input, reader.path("input"), out, errors);
  out.parameters = defaults;
  if (const json* own = reader.optional_value("parameters"); own != nullptr)
    read_parameters(*own, reader.path("parameters"), out.parameters, errors);
  reader.finish();
  return out;
}

// Makes a scan's name from its path and its series. Characters that a name cannot have become _. The
// digest distinguishes scans that have the same name without it.
std::string name_of(const json& scan, const std::string& digest) {
  std::string out = scan["path"].get<std::string>();
  for (const char* ending : {".gz", ".nii", ".nrrd", ".nhdr"})
    if ((scan["kind"] == "nifti" || scan["kind"] == "nrrd") && out.ends_with(ending))
      out.resize(out.size() - std::string(ending).size());
  // The path of a series is a file until its second file arrives, and then their folder.
  if (scan.value("files", 0) == 1) out = fs::path(out).parent_path().string();
  if (out == "." || out.empty()) out = "scan";
  if (const auto number = scan.find("number"); number != scan.end() && number->is_number())
    out += "_s" + json_text(*number);
  if (const auto volume = scan.find("volume"); volume != scan.end())
    out += "_v" + json_text(*volume);
  std::replace_if(
      out.begin(), out.end(),
      [](char c) { return !is_letter_or_digit(c) && c != '.' && c != '-' && c != '_' && c != '+'; },
      '_');
  if (out.size() > kMaxNameBytes - kDigestBytes - 8) out.resize(kMaxNameBytes - kDigestBytes - 8);
  if (!digest.empty()) out += "-" + digest.substr(0, kDigestBytes);
  return is_scan_name(out) ? out : "_" + out;
}

// The digest of a series' UID, or of a path.
std::string digest_of(const json& scan) {
  const auto uid = scan.find("uid");
  const bool has_uid = uid != scan.end() && uid->is_string();
  return sha256_of(std::string_view((has_uid ? *uid : scan["path"]).get_ref<const std::string&>()));
}

}  // namespace

bool is_scan_name(std::string_view name) {
  if (name.empty() || name.size() > kMaxNameBytes) return false;
  if (!is_letter_or_digit(name[0]) && name[0] != '_') return false;
  return std::all_of(name.begin(), name.end(), [](char c) {
    return is_letter_or_digit(c) || c == '.' || c == '_' || c == '+' || c == '-';
  });
}

Result<Collection> parse_collection(std::string_view text, const fs::path& file) {
  const auto document = parse_strict_json(text, file.string());
  if (!document) return usage(document.error().message);
  JsonErrors errors{file.string(), {}};
  StrictObject reader(*document, "", errors);
  if (const std::string schema = reader.string("schema");
      !errors.first && schema != "trocar.collection/1")
    errors.add("/schema", "must be \"trocar.collection/1\"");
  Collection out;
  out.folder = file.has_parent_path() ? file.parent_path() : ".";
  json defaults = json::object();
  if (const json* given = reader.optional_value("defaults"); given != nullptr)
    read_parameters(*given, "/defaults", defaults, errors);
  if (const json* scans = reader.array("scans", 0, kMaxScans); scans != nullptr) {
    out.scans.reserve(scans->size());
    std::unordered_map<std::string, std::size_t> by_name;
    for (std::size_t k = 0; k < scans->size() && !errors.first; ++k) {
      const std::string path = "/scans/" + std::to_string(k);
      out.scans.push_back(read_scan((*scans)[k], path, defaults, errors));
      const auto [at, is_new] = by_name.emplace(out.scans.back().name, k);
      if (!is_new)
        errors.add(path + "/name", "\"" + at->first + "\" is also the name of /scans/" +
                                       std::to_string(at->second));
    }
  }
  reader.finish();
  if (errors.first) return usage(errors.first->message);
  return out;
}

Result<Collection> read_collection(const fs::path& file) {
  const auto bytes = read_file(file, kMaxBytes);
  if (!bytes) return usage(bytes.error().message);
  return parse_collection({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, file);
}

json first_collection(const json& list, const fs::path& folder, const fs::path& relative_to,
                      std::vector<std::string>* left_out) {
  std::error_code ignored;
  const fs::path base = fs::is_regular_file(folder, ignored) ? folder.parent_path() : folder;
  std::vector<const json*> usable;
  std::map<std::string, int> same;  // scans that have a name without digest
  for (const json& scan : list["scans"]) {
    const auto localiser = scan.find("localiser");
    if (!scan["usable"].get<bool>() || (localiser != scan.end() && localiser->get<bool>()))
      continue;
    usable.push_back(&scan);
    ++same[name_of(scan, "")];
  }
  json scans = json::array();
  std::set<std::string> names;
  for (const json* const each : usable) {
    const json& scan = *each;
    fs::path path = base / scan["path"].get<std::string>();
    if (path.filename() == ".") path = path.parent_path();
    path = relative_to.empty() ? fs::weakly_canonical(path, ignored)
                               : fs::proximate(path, relative_to, ignored);
    if (!is_text(path.string()) || !is_utf8(path.string())) {
      if (left_out != nullptr) left_out->push_back(scan["path"].get<std::string>());
      continue;
    }
    const bool needs_digest = scan.contains("uid") || same[name_of(scan, "")] > 1;
    const std::string plain = name_of(scan, needs_digest ? digest_of(scan) : "");
    std::string name = plain;
    for (int k = 2; !names.insert(name).second; ++k)
      name = plain + "-" + std::to_string(k);
    json one = {{"name", name}, {"input", path.generic_string()}};
    json parameters = json::object();
    if (scan["kind"] == "dicom") {
      const bool is_file = fs::is_regular_file(base / scan["path"].get<std::string>(), ignored);
      if (!is_file) one["input"] = {{"folder", path.generic_string()}, {"series", scan["uid"]}};
      if (scan.contains("segments")) parameters["labels"] = "all";
      if (scan.contains("volume")) parameters["volume"] = scan["volume"];
    }
    if (!parameters.empty()) one["parameters"] = std::move(parameters);
    scans.push_back(std::move(one));
  }
  return {
      {"schema", "trocar.collection/1"}, {"defaults", json::object()}, {"scans", std::move(scans)}};
}

}  // namespace trocar::farm
