// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/argument_values.h"

#include <charconv>
#include <cstdint>

namespace trocar::pipeline {

Result<void> add_labels(const std::string& option, const std::string& list, std::set<int>& labels,
                        std::vector<std::set<int>>* joined) {
  constexpr int kMaxOfRange = 65536;
  const auto is_outside = [](std::errc error, int label) {
    return error == std::errc::result_out_of_range || (error == std::errc() && label < 0);
  };
  const std::string given = option + " " + list + ": ";
  const Error wrong =
      usage(given + "must be all, or labels L and ranges A-B with commas between them" +
            (joined == nullptr ? "" : ", or with + to join them"));
  const Error outside = usage(given + "labels are 0 to " + std::to_string(kMaxLabel));
  const char *at = list.data(), *const end = at + list.size();
  bool after_plus = false;
  while (true) {
    int first = 0;
    auto [rest, error] = std::from_chars(at, end, first);
    if (is_outside(error, first)) return outside;
    if (error != std::errc()) return wrong;
    int last = first;
    if (rest != end && *rest == '-') {
      const auto range = std::from_chars(rest + 1, end, last);
      if (is_outside(range.ec, last)) return outside;
      if (range.ec != std::errc()) return wrong;
      rest = range.ptr;
    }
    const bool before_plus = joined != nullptr && rest != end && *rest == '+';
    if (rest != end && *rest != ',' && !before_plus) return wrong;
    if (last < first) return usage(given + "a range ends before it begins");
    if (static_cast<std::int64_t>(last) - first >= kMaxOfRange)
      return usage(given + "a range has more than 65536 labels");
    if (before_plus && !after_plus) joined->emplace_back();
    for (std::int64_t label = first; label <= last; ++label) {
      if (before_plus || after_plus) {
        if (!joined->back().insert(static_cast<int>(label)).second)
          return usage(given + "label " + std::to_string(label) + " is joined to itself");
      } else {
        labels.insert(static_cast<int>(label));
      }
    }
    if (rest == end) return {};
    after_plus = before_plus;
    at = rest + 1;
  }
}

Result<Labels> labels(const std::vector<std::string>& lists) {
  Labels out;
  for (const std::string& list : lists) {
    if (list == "all") {
      out.all = true;
    } else if (auto ok = add_labels("--labels", list, out.labels, &out.joined); !ok) {
      return ok.error();
    }
  }
  for (const std::set<int>& joined : out.joined) {
    for (const int label : joined) {
      if (!out.labels.insert(label).second)
        return usage("--labels: label " + std::to_string(label) +
                     " is in two materials; name it once");
    }
  }
  return out;
}

}  // namespace trocar::pipeline
