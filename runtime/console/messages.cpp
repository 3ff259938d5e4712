// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/messages.h"

#include <array>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "formats/base/json_text.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

template <typename Number>
void append(std::string& bytes, Number number) {
  std::array<char, sizeof(Number)> raw{};
  std::memcpy(raw.data(), &number, sizeof number);
  bytes.append(raw.data(), raw.size());
}

template <typename Number>
void append(std::string& bytes, const std::vector<Number>& numbers) {
  bytes.append(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(Number));
}

std::string millimetres(double x_m) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.2f mm", x_m * 1e3);
  return text.data();
}

std::string in_seconds(double t_s) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.3f s", t_s);
  return text.data();
}

json as_json(const LiveEvent& event) {
  json out = {{"seq", event.number}, {"kind", to_string(event.kind)}, {"t_s", event.t_s}};
  const std::string at = " at " + in_seconds(event.t_s);
  const FaultWords& words = words_of(event.found.fault);
  std::string text;
  switch (event.kind) {
    case LiveEventKind::kPuncture: {
      out.update({{"sheet", event.sheet},
                  {"slice", event.slice},
                  {"cut", event.cut},
                  {"tool_z_m", event.tool_z_m},
                  {"penetration_m", event.penetration_m},
                  {"force_N", event.force_N},
                  {"judged_force_N", event.judged_force_N}});
      std::array<char, 32> force{};
      std::snprintf(force.data(), force.size(), "%.2f N", event.force_N);
      text = "slice " + std::to_string(event.slice) + " punctured" + at + ": " + force.data() +
             ", depth " + millimetres(event.penetration_m);
      break;
    }
    case LiveEventKind::kFault:
      out.update({{"fault", words.name},
                  {"meaning", words.meaning},
                  {"measured", measured(event.found)},
                  {"advice", words.advice}});
      text = describe(event.found, event.t_s);
      break;
    case LiveEventKind::kNotRecovered:
      out.update({{"fault", words.name},
                  {"meaning", words.still},
                  {"measured", measured(event.found)},
                  {"advice", words.advice},
                  {"lift_m", event.lift_m}});
      text = "not recovered" + at + ": ";
      if (event.found.fault == Fault::kNone) {
        text += "the tool is in material; lift it by " + millimetres(event.lift_m);
      } else {
        const std::string found = measured(event.found);
        text += words.still + (found.empty() ? "" : " (" + found + ")") + "; " + words.advice;
      }
      break;
    case LiveEventKind::kRecovered:
      out["fault"] = words.name;
      text = std::string("recovered from ") + words.name + at;
      break;
    case LiveEventKind::kCutShown:
      out.update({{"sheet", event.sheet}, {"slice", event.slice}, {"cut", event.cut}});
      text = "slice " + std::to_string(event.slice) + " has " + std::to_string(event.cut) +
             (event.cut == 1 ? " hole" : " holes") + at;
      break;
    case LiveEventKind::kPaused:
      text = "paused" + at;
      break;
    case LiveEventKind::kResumed:
      text = "goes on" + at;
      break;
    case LiveEventKind::kEnded:
      out.update({{"end", to_string(event.end)}, {"fault", words.name}});
      text = "ended" + at;
      if (event.end == LiveEnd::kInterrupted) text += ": stopped";
      if (event.end == LiveEnd::kFault) text += std::string(": ") + words.meaning;
      break;
  }
  out["text"] = std::move(text);
  return out;
}

}  // namespace

std::string event_message(const LiveEvent& event) {
  return json_text(as_json(event));
}

std::string snapshot_message(const std::vector<double>& values) {
  std::string bytes;
  append(bytes, values);
  return bytes;
}

std::string mesh_message(std::int32_t sheet, std::uint32_t cuts, std::int32_t slice,
                         const std::vector<float>& places, std::size_t floats_of_vertex,
                         const std::vector<float>& hu,
                         const std::vector<std::uint32_t>& triangles) {
  std::string bytes;
  bytes.reserve(24 + 4 * (places.size() + hu.size() + triangles.size()));
  append(bytes, sheet);
  append(bytes, cuts);
  append(bytes, slice);
  append(bytes, static_cast<std::uint32_t>(places.size() / floats_of_vertex));
  append(bytes, static_cast<std::uint32_t>(triangles.size() / 3));
  append(bytes, static_cast<std::uint32_t>(hu.empty() ? 0 : 1));
  append(bytes, places);
  append(bytes, hu);
  append(bytes, triangles);
  return bytes;
}

}  // namespace trocar::runtime
