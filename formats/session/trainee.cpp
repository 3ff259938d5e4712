// SPDX-License-Identifier: Apache-2.0
#include "formats/session/trainee.h"

#include <algorithm>
#include <charconv>

namespace trocar {
namespace {

constexpr const char* kTrainee = "trainee";
constexpr const char* kCourse = "course";
constexpr const char* kAttempt = "attempt";

Error wrong(const char* key, const std::string& why) {
  return refused(std::string("the entry ") + key + " of its origin " + why);
}

}  // namespace

bool is_trainee_code(std::string_view text) {
  return !text.empty() && text.size() <= kMaxTraineeCode &&
         std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '-' || c == '_';
         });
}

std::string trainee_code_error(std::string_view code) {
  return code.empty() || is_trainee_code(code) ? "" : "must be 1 to 32 letters, digits, - or _";
}

std::string attempt_error(std::int64_t attempt) {
  return attempt >= 1 && attempt <= kMaxAttempt ? "" : "must be within 1 and 9999";
}

std::string to_json(const Trainee& trainee) {
  if (!trainee.is_stated()) return "null";
  const auto quoted = [](const std::string& code) {
    return code.empty() ? "null" : '"' + code + '"';
  };
  return "{\"code\":" + quoted(trainee.code) + ",\"course\":" + quoted(trainee.course) +
         ",\"attempt\":" + (trainee.attempt ? std::to_string(*trainee.attempt) : "null") + "}";
}

void state_trainee(const Trainee& trainee, RecordingOrigin& origin) {
  if (!trainee.code.empty()) origin.entries.emplace_back(kTrainee, trainee.code);
  if (!trainee.course.empty()) origin.entries.emplace_back(kCourse, trainee.course);
  if (trainee.attempt) origin.entries.emplace_back(kAttempt, std::to_string(*trainee.attempt));
}

Result<Trainee> stated_trainee(const RecordingOrigin& origin) {
  Trainee trainee;
  for (const auto& [key, into] :
       {std::pair{kTrainee, &trainee.code}, std::pair{kCourse, &trainee.course}}) {
    const std::string* const text = origin.find(key);
    if (text == nullptr) continue;
    if (const std::string why = trainee_code_error(*text); !why.empty()) return wrong(key, why);
    *into = *text;
  }
  if (const std::string* const text = origin.find(kAttempt)) {
    std::int64_t attempt = 0;
    const char* const last = text->data() + text->size();
    const auto [end, error] = std::from_chars(text->data(), last, attempt);
    if (error != std::errc() || end != last) attempt = 0;
    if (const std::string why = attempt_error(attempt); !why.empty()) return wrong(kAttempt, why);
    trainee.attempt = attempt;
  }
  return trainee;
}

}  // namespace trocar
