// SPDX-License-Identifier: Apache-2.0
// The events that the console finds in a recording.
#include "runtime/console/answers.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "formats/session/recording.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

using nlohmann::json;

/// Returns the JSON of the console's answer for a recording of these rows, at 1 kHz.
json answer_for(std::vector<RecordingRow> rows, const char* device_kind = "legs") {
  const test::TemporaryFolder folder;
  for (std::size_t i = 0; i < rows.size(); ++i)
    rows[i].t_s = static_cast<double>(i) / 1000;
  RecordingOrigin origin;
  origin.entries = {
      {"rate_Hz", "1000"}, {kOriginXray, "counted"}, {kOriginDeviceKind, device_kind}};
  auto writer = RecordingWriter::open(folder / "r.csv", origin);
  EXPECT_TRUE(writer && writer->append(rows) && writer->commit());
  const auto answer = rows_of(folder / "r.csv");
  EXPECT_TRUE(answer) << answer.error().message;
  std::uint32_t size = 0;
  std::memcpy(&size, answer->data(), sizeof size);
  return json::parse(answer->substr(sizeof size, size));
}

json events_of(std::vector<RecordingRow> rows) {
  return answer_for(std::move(rows))["events"];
}

TEST(Rows, AnEmergencyStopDuringTheRecoveryFromAnotherOneIsAnEventOfItsOwn) {
  std::vector<RecordingRow> rows;
  const auto add = [&rows](SafetyState safety, Fault fault) {
    RecordingRow row;
    row.safety = safety;
    row.fault = fault;
    rows.push_back(row);
  };
  add(SafetyState::kRunning, Fault::kNone);
  for (int i = 0; i < 2; ++i) {
    add(SafetyState::kFault, Fault::kEmergencyStop);
    add(SafetyState::kFault, Fault::kEmergencyStop);
    add(SafetyState::kRecovering, Fault::kEmergencyStop);
  }
  add(SafetyState::kReady, Fault::kNone);
  std::vector<std::pair<std::string, double>> found;
  for (const json& event : events_of(rows))
    found.emplace_back(event["kind"].get<std::string>(), event["t_s"].get<double>());
  const std::vector<std::pair<std::string, double>> expected = {
      {"fault", 0.001}, {"fault", 0.004}, {"recovered", 0.007}};
  EXPECT_EQ(found, expected);
}

TEST(Rows, ARecordingOfAPoseDeviceHasNoTorquesAndNoAnglesOfMotors) {
  for (const char* kind : {"legs", "pose"}) {
    std::set<std::string> names;
    std::size_t width = 0;
    const json answer = answer_for(std::vector<RecordingRow>(3), kind);
    for (const json& column : answer["columns"]) {
      names.insert(column["name"].get<std::string>());
      width += column["count"].get<std::size_t>();
    }
    EXPECT_EQ(answer["rows_at"][1].get<std::size_t>(), 3 * width);
    EXPECT_TRUE(names.contains("wrench_delivered"));
    for (const char* of_motors : {"tau_Nm", "motor_angle_rad"})
      EXPECT_EQ(names.contains(of_motors), std::string(kind) == "legs") << of_motors;
  }
}

TEST(Rows, TheNumberOfEventsIsBounded) {
  std::vector<RecordingRow> rows(19'999);
  for (std::size_t i = 0; i < rows.size(); i += 2)
    rows[i].xray = kXrayBeam;  // each row switches it on or off
  RecordingRow row;
  row.xray = kXrayPicture;
  rows.insert(rows.end(), 1001, row);  // the first of these is a picture and the end of screening
  EXPECT_EQ(events_of(rows).size(), 20'001U);
}

}  // namespace
}  // namespace trocar::runtime
