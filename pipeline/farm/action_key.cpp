// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/action_key.h"

#include <unordered_map>

#include "formats/base/json_text.h"
#include "pipeline/farm/sha256.h"

namespace trocar::farm {

using nlohmann::json;

json action_of(const std::string& program, const json& parameters,
               const std::vector<NamedFile>& wanted, const std::vector<ScanFile>& files) {
  std::unordered_map<std::string, const ScanFile*> by_path;
  for (const ScanFile& file : files)
    by_path.emplace(file.of + ":" + file.path, &file);
  json out = {{"schema", "trocar.action/1"}, {"program", program}, {"parameters", parameters}};
  for (const NamedFile& one : wanted)
    out[one.of].push_back(by_path.at(one.of + ":" + one.path.string())->sha256);
  return out;
}

std::string key_of(const json& action) {
  return sha256_of(json_text(action));
}

}  // namespace trocar::farm
