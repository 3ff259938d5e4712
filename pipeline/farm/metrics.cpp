// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/metrics.h"

#include <cstddef>
#include <cstdio>
#include <utility>

namespace trocar::farm {
namespace {

std::string quoted(const std::string& value) {
  std::string out = "\"";
  for (const char c : value) {
    if (c == '\\' || c == '"') out += '\\';
    out += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return out + '"';
}

std::string seconds_text(double seconds) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3f", seconds);
  return text;
}

std::string head(const std::string& name, const std::string& help) {
  return "# HELP " + name + " " + help + "\n# TYPE " + name + " gauge\n";
}

}  // namespace

std::string metrics_text(const BatchSummary& summary, const std::string& store,
                         std::chrono::system_clock::time_point end) {
  const std::string label = "{store=" + quoted(store);
  const std::pair<const char*, std::size_t> classes[] = {{"unchanged", summary.unchanged},
                                                         {"made", summary.made},
                                                         {"found", summary.found},
                                                         {"failed", summary.failed.size()},
                                                         {"known_failure", summary.known.size()},
                                                         {"left", summary.left}};
  std::string out = head("trocar_batch_scans", "Scans of the last run, each in one class.");
  for (const auto& [name, count] : classes)
    out +=
        "trocar_batch_scans" + label + ",class=\"" + name + "\"} " + std::to_string(count) + "\n";
  const auto add = [&](const std::string& name, const std::string& help, const std::string& value) {
    out += head(name, help) + name + label + "} " + value + "\n";
  };
  add("trocar_batch_asset_bytes",
      "Size of the assets of those scans of the last run that are done.",
      std::to_string(summary.asset_bytes));
  add("trocar_batch_duration_seconds", "Duration of the last run.", seconds_text(summary.seconds));
  add("trocar_batch_end_timestamp_seconds",
      "Unix time at which the last run ended; time() minus this value is its age.",
      seconds_text(std::chrono::duration<double>(end.time_since_epoch()).count()));
  return out;
}

}  // namespace trocar::farm
