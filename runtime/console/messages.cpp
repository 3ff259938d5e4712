// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/messages.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "formats/base/json_text.h"
#include "formats/base/text_line.h"
#include "formats/session/recording.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

template <typename Number>
void append(std::string& bytes, Number number) {
  bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

template <typename Number>
void append(std::string& bytes, const std::vector<Number>& numbers) {
  bytes.append(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(Number));
}

json as_json(const TelemetryEvent& event) {
  json out = {{"seq", event.number}, {"kind", to_string(event.kind)}, {"t_s", event.t_s}};
  const std::string at = text_line(" at %.3f s", event.t_s);
  const FaultWords& words = words_of(event.found.fault);
  std::string text;
  switch (event.kind) {
    case TelemetryEventKind::kPuncture: {
      out.update({{"sheet", event.sheet},
                  {"slice", event.slice},
                  {"cut", event.cut},
                  {"tool_z_m", event.tool_z_m},
                  {"penetration_m", event.penetration_m},
                  {"tip_N", event.tip_N},
                  {"hand_N", event.hand_N},
                  {"trial_force_N", event.trial_force_N}});
      text =
          text_line("slice %d punctured%s: %.2f N at the tip, %.2f N on the hand, depth %.2f mm",
                    event.slice, at.c_str(), event.tip_N, event.hand_N, event.penetration_m * 1e3);
      break;
    }
    case TelemetryEventKind::kBreakThrough:
      out.update({{"sheet", event.sheet},
                  {"at", event.slice},
                  {"tool_z_m", event.tool_z_m},
                  {"tip_N", event.tip_N}});
      text = describe_break_through(event.slice, event.t_s, event.tip_N);
      break;
    case TelemetryEventKind::kFault:
      out.update({{"fault", words.name},
                  {"meaning", words.meaning},
                  {"measured", measured(event.found)},
                  {"advice", words.advice}});
      text = describe(event.found, event.t_s);
      break;
    case TelemetryEventKind::kNotRecovered:
      out.update({{"fault", words.name},
                  {"meaning", words.meaning_in_recovery},
                  {"measured", measured(event.found)},
                  {"advice", words.advice},
                  {"retract_distance_m", event.retract_distance_m}});
      text = "not recovered" + at + ": ";
      if (event.found.fault == Fault::kNone) {
        text += text_line("the tool is in material; lift it by %.2f mm",
                          event.retract_distance_m * 1e3);
      } else {
        const std::string found = measured(event.found);
        text += words.meaning_in_recovery + (found.empty() ? "" : " (" + found + ")") + "; " +
                words.advice;
      }
      break;
    case TelemetryEventKind::kRecovered:
      out["fault"] = words.name;
      text = std::string("recovered from ") + words.name + at;
      break;
    case TelemetryEventKind::kRecoveryRefused: {
      const std::string why = refusal_words(event.found.fault);
      out.update({{"fault", words.name}, {"why", why}});
      text = "recovery refused" + at + ": " + why;
      break;
    }
    case TelemetryEventKind::kCutShown:
      out.update({{"sheet", event.sheet}, {"slice", event.slice}, {"cut", event.cut}});
      text = text_line("slice %d has %u %s%s", event.slice, event.cut,
                       event.cut == 1 ? "hole" : "holes", at.c_str());
      break;
    case TelemetryEventKind::kPaused:
      text = "paused" + at;
      break;
    case TelemetryEventKind::kResumed:
      text = "resumed" + at;
      break;
    case TelemetryEventKind::kHand:
      text = "a hand holds the tool" + at;
      break;
    case TelemetryEventKind::kHandLetGo:
      text = "the hand let go" + at;
      break;
    case TelemetryEventKind::kHandLost:
      text = "the hand was lost" + at + ": nothing came from it for 250 ms, so it lets go";
      break;
    case TelemetryEventKind::kXrayShot:
      text = "X-ray shot" + at;
      break;
    case TelemetryEventKind::kXrayOn:
      text = "X-ray screening began" + at;
      break;
    case TelemetryEventKind::kXrayOff:
      text = "X-ray screening ended" + at;
      break;
    case TelemetryEventKind::kEnded:
      out.update({{"end", to_string(event.end)}, {"fault", words.name}});
      text = "ended" + at;
      if (event.end == TelemetryEnd::kInterrupted) text += ": stopped";
      if (event.end == TelemetryEnd::kFault) text += std::string(": ") + words.meaning;
      break;
  }
  out["text"] = std::move(text);
  return out;
}

}  // namespace

std::string event_message(const TelemetryEvent& event) {
  return json_text(as_json(event));
}

std::string snapshot_message(const std::vector<double>& values) {
  std::string bytes;
  append(bytes, values);
  return bytes;
}

std::string history_message(const std::vector<ForceHistory::Point>& points) {
  std::string bytes;
  for (const ForceHistory::Point& point : points)
    for (const double number : {point.t_s, point.force_N, point.tip_z_m})
      append(bytes, number);
  return bytes;
}

std::string mesh_message(std::int32_t sheet, std::uint32_t cuts, std::int32_t slice,
                         const std::vector<float>& positions, std::size_t floats_of_vertex,
                         const std::vector<float>& hu,
                         const std::vector<std::uint32_t>& triangles) {
  std::string bytes;
  bytes.reserve(24 + 4 * (positions.size() + hu.size() + triangles.size()));
  append(bytes, sheet);
  append(bytes, cuts);
  append(bytes, slice);
  append(bytes, static_cast<std::uint32_t>(positions.size() / floats_of_vertex));
  append(bytes, static_cast<std::uint32_t>(triangles.size() / 3));
  append(bytes, static_cast<std::uint32_t>(hu.empty() ? 0 : 1));
  append(bytes, positions);
  append(bytes, hu);
  append(bytes, triangles);
  return bytes;
}

}  // namespace trocar::runtime
