// SPDX-License-Identifier: Apache-2.0
#include "formats/session/recording.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <thread>

#include "formats/base/files.h"
#include "tests/support/file_size_limit.h"
#include "tests/support/temporary_folder.h"

// While these tests run, no file system has hard links.
extern "C" int link(const char* /*from*/, const char* /*to*/) noexcept {
  errno = EPERM;
  return -1;
}

namespace trocar {
namespace {

namespace fs = std::filesystem;

class Recording : public testing::Test {
 protected:
  std::size_t files() const { return temporary_.files(); }
  test::TemporaryFolder temporary_;
  fs::path folder_ = temporary_.path();
};

/// Any finite double; all exponents are equally likely.
double any_double(std::mt19937_64& random) {
  for (;;) {
    const double x = std::bit_cast<double>(random());
    if (std::isfinite(x)) return x;
  }
}

std::vector<RecordingRow> any_rows(std::size_t count) {
  std::mt19937_64 random(20);
  std::vector<RecordingRow> rows(count);
  for (std::size_t i = 0; i < count; ++i) {
    RecordingRow& row = rows[i];
    row.t_s = static_cast<double>(i) / 3;
    const auto fill = [&](auto&... numbers) {
      const auto each = [&](auto& all) {
        for (double& x : all)
          x = any_double(random);
      };
      (each(numbers), ...);
    };
    fill(row.p_m, row.tool_m, row.q, row.wrench_wanted, row.wrench_delivered, row.tau_Nm,
         row.encoder_rad);
    row.phase = static_cast<ContactPhase>(random() % 5);
    row.active_slice = static_cast<std::int32_t>(random() % 40) - 1;
    row.penetration_m = any_double(random);
    row.wrench_scale = any_double(random);
    row.pose_residual_m = any_double(random);
    row.cuts_published = static_cast<std::int64_t>(random() >> 1);
    row.fault = static_cast<Fault>(random() % kFaults);
    row.device_read = static_cast<DeviceStatus>(random() % kRecordedDeviceStatuses);
    row.state_t_s = any_double(random);
    row.device_write = static_cast<DeviceStatus>(random() % kRecordedDeviceStatuses);
    row.outside_fault = static_cast<Fault>(random() % kFaults);
    row.recovery_asked = static_cast<std::uint8_t>(random() % 2);
    row.safety = static_cast<SafetyState>(random() % kSafetyStates);
    for (double* x : {&row.authority, &row.passivity_J, &row.passivity_N_s_per_m,
                      &row.motor_heat_max, &row.tip_N, &row.break_through_N})
      *x = any_double(random);
    row.break_through_at = static_cast<std::int32_t>(random() % 40) - 5;
    row.xray = static_cast<std::uint8_t>(random() % 4);
  }
  rows[0].p_m = {std::numeric_limits<double>::denorm_min(), -0.0,
                 std::numeric_limits<double>::max()};
  return rows;
}

template <std::size_t N>
bool same_bits(const std::array<double, N>& a, const std::array<double, N>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), [](double x, double y) {
    return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
  });
}

bool same(const RecordingRow& a, const RecordingRow& b) {
  return same_bits(
             std::array{a.t_s, a.state_t_s, a.penetration_m, a.wrench_scale, a.pose_residual_m},
             std::array{b.t_s, b.state_t_s, b.penetration_m, b.wrench_scale, b.pose_residual_m}) &&
         same_bits(a.p_m, b.p_m) && same_bits(a.q, b.q) && same_bits(a.tool_m, b.tool_m) &&
         same_bits(a.wrench_wanted, b.wrench_wanted) &&
         same_bits(a.wrench_delivered, b.wrench_delivered) && same_bits(a.tau_Nm, b.tau_Nm) &&
         same_bits(a.encoder_rad, b.encoder_rad) && a.phase == b.phase &&
         a.active_slice == b.active_slice && a.cuts_published == b.cuts_published &&
         a.fault == b.fault && a.device_read == b.device_read && a.device_write == b.device_write &&
         a.outside_fault == b.outside_fault && a.recovery_asked == b.recovery_asked &&
         a.safety == b.safety &&
         same_bits(std::array{a.authority, a.passivity_J, a.passivity_N_s_per_m, a.motor_heat_max,
                              a.tip_N, a.break_through_N},
                   std::array{b.authority, b.passivity_J, b.passivity_N_s_per_m, b.motor_heat_max,
                              b.tip_N, b.break_through_N}) &&
         a.break_through_at == b.break_through_at;
}

std::string text_of(const fs::path& file) {
  const auto bytes = read_file(file);
  return bytes ? std::string(bytes->begin(), bytes->end()) : std::string();
}

std::string csv_of(const fs::path& folder, std::span<const RecordingRow> rows,
                   const RecordingOrigin& origin = {}) {
  auto writer = RecordingWriter::open(folder / "r.csv", origin);
  EXPECT_TRUE(writer);
  EXPECT_TRUE(writer->append(rows));
  EXPECT_TRUE(writer->commit());
  return text_of(folder / "r.csv");
}

const RecordingOrigin kCountsXray{{{"program", "x"}, {kOriginXray, "counted"}}};

TEST_F(Recording, ReadingGivesTheWrittenValuesBitForBit) {
  const std::vector<RecordingRow> rows = any_rows(5000);
  csv_of(folder_, rows, kCountsXray);
  const auto read = read_recording(folder_ / "r.csv");
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    ASSERT_TRUE(same(rows[i], (*read)[i])) << i;
    ASSERT_EQ(rows[i].xray, (*read)[i].xray) << i;
  }
  EXPECT_EQ(files(), 1U) << "no temporary file is left";
}

/// Rows of the force law `cutting`.
std::vector<RecordingRow> any_cutting_rows(std::size_t count) {
  std::vector<RecordingRow> rows = any_rows(count);
  std::mt19937_64 random(21);
  for (RecordingRow& row : rows) {
    RecordingRow::Cutting& cutting = row.cutting;
    for (double& x : cutting.wrench_tissue)
      x = any_double(random);
    for (double* x : {&cutting.front_z_m, &cutting.front_HU, &cutting.embedded_m, &cutting.cut_J,
                      &cutting.absorbed_J, &cutting.stored_J})
      *x = any_double(random);
    cutting.steps = static_cast<std::int32_t>(random() % 100);
  }
  return rows;
}

bool same_cutting(const RecordingRow::Cutting& a, const RecordingRow::Cutting& b) {
  return same_bits(a.wrench_tissue, b.wrench_tissue) &&
         same_bits(
             std::array{a.front_z_m, a.front_HU, a.embedded_m, a.cut_J, a.absorbed_J, a.stored_J},
             std::array{b.front_z_m, b.front_HU, b.embedded_m, b.cut_J, b.absorbed_J,
                        b.stored_J}) &&
         a.steps == b.steps;
}

const RecordingOrigin kOfCutting{{{"force-law", "cutting"}}};

TEST_F(Recording, ThoseOfTheCuttingLawHaveItsColumnsBitForBit) {
  const std::vector<RecordingRow> rows = any_cutting_rows(2000);
  const std::string csv = csv_of(folder_, rows, kOfCutting);
  EXPECT_EQ(csv.substr(0, csv.find('\n')), recording_header({.has_cutting = true}));
  RecordingOrigin origin;
  const auto read = read_recording(folder_ / "r.csv", &origin);
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(origin, kOfCutting);
  ASSERT_EQ(read->size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    ASSERT_TRUE(same(rows[i], (*read)[i])) << i;
    ASSERT_TRUE(same_cutting(rows[i].cutting, (*read)[i].cutting)) << i;
  }
}

TEST_F(Recording, OtherLawsRecordNothingOfTheCuttingLaw) {
  const std::vector<RecordingRow> rows = any_cutting_rows(20);
  for (const RecordingOrigin& origin :
       {RecordingOrigin{}, RecordingOrigin{{{"force-law", "hooke"}}},
        RecordingOrigin{{{"force-law", "network"}}}, RecordingOrigin{{{"scene", "cutting"}}}}) {
    const std::string csv = csv_of(folder_, rows, origin);
    EXPECT_EQ(csv.substr(0, csv.find('\n')), recording_header());
    const auto read = read_recording(folder_ / "r.csv");
    ASSERT_TRUE(read) << read.error().message;
    ASSERT_EQ(read->size(), rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      EXPECT_TRUE(same(rows[i], (*read)[i]));
      EXPECT_TRUE(same_cutting({}, (*read)[i].cutting));
      EXPECT_EQ((*read)[i].xray, 0) << "only recordings that count have the column";
    }
  }
}

TEST_F(Recording, CorruptedColumnsOfTheCuttingLawAreRefused) {
  const std::string good = csv_of(folder_, any_cutting_rows(3), kOfCutting);
  const std::size_t second = good.find('\n', good.find('\n') + 1) + 1;
  const std::size_t end = good.find('\n', second);
  const char* const names[] = {
      "break_through_at", "break_through_N", "steps",        "tissue_stored_J",
      "absorbed_J",       "cut_J",           "embedded_m",   "tip_N",
      "front_HU",         "front_z_m",       "tz_tissue_Nm", "ty_tissue_Nm",
      "tx_tissue_Nm",     "fz_tissue_N",     "fy_tissue_N",  "fx_tissue_N"};
  std::size_t after = good.rfind(',', end);  // behind the field
  for (const char* name : names) {
    const std::size_t before = good.rfind(',', after - 1);
    const auto with = [&](const std::string& text) {
      std::string bad = good;
      bad.replace(before + 1, after - before - 1, text);
      const auto result = parse_recording(bad, "c.csv");
      return result ? std::string("taken") : result.error().message;
    };
    const std::string where = std::string("c.csv: line 3: ") + name + " is not ";
    EXPECT_EQ(with("x"), where + "a number");
    EXPECT_EQ(with("nan"), where + (name == names[0] || name == names[2] ? "a number" : "finite"));
    after = before;
  }
  // A header with some of the columns only is none.
  for (const char* name : names) {
    std::string bad = good;
    const std::size_t at = bad.find(std::string(",") + name);
    bad.erase(at, std::string(name).size() + 1);
    EXPECT_EQ(parse_recording(bad, "c.csv").error().message,
              "c.csv: line 1: is not the header of a recording")
        << name;
  }
}

TEST_F(Recording, TheSchemasNameEveryFaultAndState) {
  const auto schema = [](const std::string& name) {
    std::ifstream file(TROCAR_SCHEMAS "/" + name + ".schema.json");
    return nlohmann::json::parse(file);
  };
  std::set<std::string> faults, states;
  for (int i = 1; i < kFaults; ++i)
    faults.insert(to_string(static_cast<Fault>(i)));
  for (int i = 0; i <= static_cast<int>(ContactPhase::kFault); ++i)
    states.insert(to_string(static_cast<ContactPhase>(i)));
  using Pointer = nlohmann::json::json_pointer;
  const Pointer of_faults("/properties/faults/items/properties/fault/enum");
  EXPECT_EQ(schema("summary").at(of_faults).get<std::set<std::string>>(), faults);
  const Pointer of_states("/$defs/frame/properties/state/enum");
  EXPECT_EQ(schema("frames").at(of_states).get<std::set<std::string>>(), states);
}

TEST_F(Recording, AnUnknownNumberOfXraysIsRefused) {
  std::vector<RecordingRow> rows(1);
  rows[0].xray = 3;
  std::string csv = csv_of(folder_, rows, kCountsXray);
  const std::size_t at = csv.rfind(",3,");
  ASSERT_NE(at, std::string::npos);
  csv[at + 1] = '4';
  const auto read = parse_recording(csv, "r.csv");
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("is an unknown number"), std::string::npos);
}

TEST_F(Recording, EncodersThatAreNotFiniteCanBeRecorded) {
  std::vector<RecordingRow> rows(1);
  rows[0].encoder_rad[5] = std::numeric_limits<double>::quiet_NaN();
  rows[0].encoder_rad[6] = -std::numeric_limits<double>::infinity();
  const auto read = parse_recording(csv_of(folder_, rows), "r");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_TRUE(std::isnan((*read)[0].encoder_rad[5]));
  EXPECT_EQ((*read)[0].encoder_rad[6], -std::numeric_limits<double>::infinity());
}

TEST_F(Recording, CorruptedRowsAreRefusedNamingLineAndColumn) {
  const std::string good = csv_of(folder_, any_rows(3));
  ASSERT_TRUE(parse_recording(good, "r.csv"));
  const std::size_t header = good.find('\n') + 1;
  const std::size_t second = good.find('\n', header) + 1;  // the row of t_s = 1/3
  const auto with = [&](std::size_t at, std::size_t length, const std::string& text) {
    std::string bad = good;
    bad.replace(at, length, text);
    const auto result = parse_recording(bad, "r.csv");
    EXPECT_FALSE(result) << text;
    return result ? std::string() : result.error().message;
  };
  const std::size_t comma = good.find(',', second);
  EXPECT_EQ(with(second, comma - second, "x"), "r.csv: line 3: t_s is not a number");
  EXPECT_EQ(with(second, comma - second, "0.5x"), "r.csv: line 3: t_s is not a number");
  EXPECT_EQ(with(second, comma - second, ""), "r.csv: line 3: t_s is not a number");
  EXPECT_EQ(with(second, comma - second, "inf"), "r.csv: line 3: t_s is not finite");
  EXPECT_EQ(with(second, comma - second, "0"),
            "r.csv: line 3: t_s is not later than in the row before");
  EXPECT_EQ(with(second, comma - second + 1, ""), "r.csv: line 3: th_4_4_rad is not a number");
  EXPECT_EQ(with(second, 0, "0.1,"), "r.csv: line 3: state is an unknown name");
  const std::size_t end = good.find('\n', second);
  const std::size_t last = good.rfind(',', end);
  EXPECT_EQ(with(last, end - last, ""), "r.csv: line 3: origin is missing");
  EXPECT_EQ(with(end, 0, ",1"), "r.csv: line 3: has too many fields");
  EXPECT_EQ(with(last, 0, "s"), "r.csv: line 3: break_through_at is not a number");
  std::size_t asked = end;
  for (int fields = 0; fields < 10; ++fields)
    asked = good.rfind(',', asked - 1);  // before recovery_asked
  EXPECT_EQ(with(asked + 1, 1, "2"), "r.csv: line 3: recovery_asked is neither 0 nor 1");
  EXPECT_EQ(with(asked, 0, "x"), "r.csv: line 3: outside_fault is an unknown name");
  EXPECT_EQ(with(second, 0, "\n"), "r.csv: line 3: t_s is not a number");
  EXPECT_EQ(with(0, 1, "T"), "r.csv: line 1: is not the header of a recording");
  EXPECT_EQ(with(header, good.size() - header, ""), "r.csv: has no row");
  EXPECT_FALSE(parse_recording("", "r.csv"));
  // A recording that is cut anywhere except at a line's end is refused.
  for (std::size_t length = 0; length < good.size(); ++length) {
    const bool whole_rows = length > header && good[length - 1] == '\n';
    EXPECT_EQ(bool(parse_recording(good.substr(0, length), "r.csv")), whole_rows) << length;
  }
}

TEST_F(Recording, TheOriginIsInTheFirstRowOfTheLastColumn) {
  const RecordingOrigin origin{{{"program", "0.2.0"}, {"scene", "00ff"}, {"coupling", "1e+05"}}};
  const std::vector<RecordingRow> rows = any_rows(3);
  {
    auto writer = RecordingWriter::open(folder_ / "r.csv", origin);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->append(std::span(rows).first(1)));
    ASSERT_TRUE(writer->append(std::span(rows).subspan(1)));
    ASSERT_TRUE(writer->commit());
  }
  const std::string csv = text_of(folder_ / "r.csv");
  EXPECT_NE(csv.find(",break_through_at,origin\n"), std::string::npos);
  const std::size_t text = csv.find(",program=0.2.0;scene=00ff;coupling=1e+05\n");
  ASSERT_NE(text, std::string::npos);
  EXPECT_EQ(std::count(csv.begin(), csv.begin() + static_cast<std::ptrdiff_t>(text), '\n'), 1);
  RecordingOrigin read;
  const auto again = read_recording(folder_ / "r.csv", &read);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(read, origin);
  EXPECT_EQ(again->size(), 3U);
  for (const char* bad : {"program", "=1", "a=1;a=2", "a=1;", ";", "a=b c", "a=\"b\"", "a=#"}) {
    std::string forged = csv;
    forged.replace(text + 1, csv.find('\n', text) - text - 1, bad);
    const auto refused = parse_recording(forged, "r.csv", &read);
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ(refused.error().message, "r.csv: line 2: origin is not KEY=VALUE;KEY=VALUE");
  }
  std::string late = csv;
  late.insert(csv.size() - 1, "a=1");
  EXPECT_EQ(parse_recording(late, "r.csv").error().message,
            "r.csv: line 4: origin belongs to the first row only");
}

TEST(RecordingOrigin, DifferencesNameWhatDiffers) {
  const RecordingOrigin recorded{{{"program", "0.1.0"},
                                  {"scene", std::string(64, 'a')},
                                  {"asset", std::string(64, 'b')},
                                  {"device", "built-in"},
                                  {"passivity", "on"}}};
  RecordingOrigin run = recorded;
  run.entries.emplace_back("force-scale", "2");
  EXPECT_EQ(differences(recorded, run), "force-scale (not stated, here 2)");
  run.entries[0].second = "0.2.0";
  EXPECT_EQ(differences(recorded, run), "") << "the program and later options do not count";
  run.entries[1].second = std::string(64, 'c');
  run.entries[3].second = std::string(64, 'd');
  run.entries[4].second = "off";
  EXPECT_EQ(differences(recorded, run),
            "the scene (aaaaaaaaaaaa..., here cccccccccccc...), the device (built-in, here "
            "dddddddddddd...), passivity (on, here off)");
  run.entries.erase(run.entries.begin() + 2);
  EXPECT_NE(differences(recorded, run).find("the asset (bbbbbbbbbbbb..., here not stated)"),
            std::string::npos);
}

TEST_F(Recording, WithoutCommitTheRowsAreKeptUnderTheDocumentedName) {
  const std::vector<RecordingRow> rows = any_rows(2000);
  {
    auto writer = RecordingWriter::open(folder_ / "r.csv");
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->append(rows));
    EXPECT_TRUE(fs::exists(folder_ / "r.csv.partial")) << "while it is being written";
  }
  EXPECT_FALSE(fs::exists(folder_ / "r.csv"));
  const auto kept = read_recording(folder_ / "r.csv.partial");
  ASSERT_TRUE(kept) << kept.error().message;
  EXPECT_EQ(kept->size(), rows.size());
  fs::remove(folder_ / "r.csv.partial");
  { ASSERT_TRUE(RecordingWriter::open(folder_ / "r.csv")); }
  EXPECT_EQ(files(), 0U) << "no row: no file";
}

TEST_F(Recording, WhatInterruptedRecordingsLeftIsMovedAside) {
  for (const char* rows : {"an hour's work", "another hour's work"}) {
    std::ofstream(folder_ / "r.csv.partial") << rows;
    auto writer = RecordingWriter::open(folder_ / "r.csv");
    ASSERT_TRUE(writer) << writer.error().message;
    ASSERT_TRUE(writer->append(any_rows(1)));
    ASSERT_TRUE(writer->commit());
  }
  EXPECT_EQ(text_of(folder_ / "r.csv.partial.1"), "an hour's work");
  EXPECT_EQ(text_of(folder_ / "r.csv.partial.2"), "another hour's work");
  EXPECT_FALSE(fs::exists(folder_ / "r.csv.partial"));
}

TEST_F(Recording, TwoWritersOfOneFileAreRefused) {
  auto first = RecordingWriter::open(folder_ / "r.csv");
  ASSERT_TRUE(first) << first.error().message;
  const auto second = RecordingWriter::open(folder_ / "r.csv");
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ExitCode::kUnwritable);
  EXPECT_NE(second.error().message.find("another program is recording there"), std::string::npos);
  EXPECT_TRUE(first->append(any_rows(1)));
  EXPECT_TRUE(first->commit());
}

// A limit of the file size fails like a full disk: after the bytes that fit.
TEST_F(Recording, AFullDiskKeepsTheWholeRowsThatFit) {
  const std::vector<RecordingRow> rows = any_rows(5000);
  const std::string whole = csv_of(folder_, rows);
  fs::remove(folder_ / "r.csv");
  for (const std::size_t fits : {recording_header().size() + 10, std::size_t{100'000},
                                 std::size_t{1'100'000}, whole.size() - 1}) {
    const std::size_t end = whole.rfind('\n', fits - 1) + 1;
    const auto kept =
        std::count(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(end), '\n') - 1;
    std::string said;
    {
      const test::FileSizeLimit limit(fits);
      auto writer = RecordingWriter::open(folder_ / "r.csv");
      ASSERT_TRUE(writer);
      Result<void> done = writer->append(rows);
      if (done) done = writer->commit();
      ASSERT_FALSE(done);
      EXPECT_EQ(done.error().code, ExitCode::kUnwritable);
      said = done.error().message + "; " + writer->kept();
    }
    EXPECT_NE(said.find("r.csv: File too large"), std::string::npos) << said;
    EXPECT_FALSE(fs::exists(folder_ / "r.csv"));
    if (kept < 1) {
      EXPECT_NE(said.find("no row was kept"), std::string::npos) << said;
      EXPECT_EQ(files(), 0U);
      continue;
    }
    EXPECT_NE(said.find("first " + std::to_string(kept) + " rows are in "), std::string::npos)
        << said;
    EXPECT_NE(said.find("r.csv.partial"), std::string::npos) << said;
    EXPECT_EQ(text_of(folder_ / "r.csv.partial"), whole.substr(0, end)) << fits;
    fs::remove(folder_ / "r.csv.partial");
  }
}

TEST_F(Recording, WhatDidNotFitIsWrittenOnceThereIsSpace) {
  const std::vector<RecordingRow> rows = any_rows(500);
  const std::string whole = csv_of(folder_, rows);
  auto writer = RecordingWriter::open(folder_ / "r.csv");
  ASSERT_TRUE(writer);
  {
    const test::FileSizeLimit limit(100'000);
    ASSERT_FALSE(writer->append(std::span(rows).first(300)));
    const std::string kept = text_of(folder_ / "r.csv.partial");
    EXPECT_GT(kept.size(), 90'000U);
    EXPECT_TRUE(kept.ends_with('\n')) << "whole rows";
  }
  EXPECT_TRUE(writer->append(std::span(rows).subspan(300)));
  EXPECT_TRUE(writer->commit());
  EXPECT_EQ(text_of(folder_ / "r.csv"), whole);
  EXPECT_EQ(writer->kept(), "the first 500 rows are in " + (folder_ / "r.csv").string());
}

TEST_F(Recording, ADiskThatIsFullFromTheBeginningIsToldAtOnce) {
  const test::FileSizeLimit limit(100);
  const auto writer = RecordingWriter::open(folder_ / "r.csv");
  ASSERT_FALSE(writer);
  EXPECT_EQ(writer.error().code, ExitCode::kUnwritable);
  EXPECT_EQ(files(), 0U);
}

// A program that is killed loses what it has not written.
TEST_F(Recording, RowsAreWrittenSoonAfterTheyCame) {
  const std::vector<RecordingRow> rows = any_rows(3);
  auto writer = RecordingWriter::open(folder_ / "r.csv");
  ASSERT_TRUE(writer);
  const auto rows_in_file = [&] {
    const std::string text = text_of(folder_ / "r.csv.partial");
    return std::count(text.begin(), text.end(), '\n') - 1;
  };
  EXPECT_EQ(rows_in_file(), 0);
  std::this_thread::sleep_for(RecordingWriter::kFlushWithin);
  ASSERT_TRUE(writer->append(std::span(rows).first(2)));
  EXPECT_EQ(rows_in_file(), 2);
  ASSERT_TRUE(writer->append(std::span(rows).subspan(2)));
  std::this_thread::sleep_for(RecordingWriter::kFlushWithin);
  ASSERT_TRUE(writer->append({}));
  EXPECT_EQ(rows_in_file(), 3) << "also if no more rows come";
}

TEST_F(Recording, ALastLineThatIsCutIsLeftOutForThoseWhoCanSaySo) {
  const std::string good = csv_of(folder_, any_rows(3));
  const std::size_t header = good.find('\n') + 1, last = good.rfind('\n', good.size() - 2) + 1;
  bool is_cut = true;
  EXPECT_EQ(parse_recording(good, "r.csv", nullptr, &is_cut)->size(), 3U);
  EXPECT_FALSE(is_cut);
  for (std::size_t length = header; length < good.size(); ++length) {
    const bool has_row = length > good.find('\n', header);
    const auto read = parse_recording(good.substr(0, length), "r.csv", nullptr, &is_cut);
    EXPECT_EQ(bool(read), has_row) << length;
    EXPECT_EQ(is_cut, good[length - 1] != '\n') << length;
  }
  std::ofstream(folder_ / "r.csv.partial") << good.substr(0, last + 30);
  EXPECT_EQ(read_recording(folder_ / "r.csv.partial", nullptr, &is_cut)->size(), 2U);
  EXPECT_TRUE(is_cut);
  EXPECT_FALSE(read_recording(folder_ / "r.csv.partial"));
  std::string within = good;
  within.erase(last - 2, 2);  // a line feed is missing within
  EXPECT_FALSE(parse_recording(within, "r.csv", nullptr, &is_cut));
}

TEST_F(Recording, NamesOfPartialFiles) {
  for (const char* name : {"r.csv.partial", "a/r.csv.partial.1", "r.partial.10"})
    EXPECT_TRUE(is_partial_name(name)) << name;
  for (const char* name : {"", "1", "r.csv", "r.csv.partial.", "r.csv.partial1", "r.partial.csv"})
    EXPECT_FALSE(is_partial_name(name)) << name;
  {
    auto writer = RecordingWriter::open(folder_ / "r.csv");
    ASSERT_TRUE(writer->append(any_rows(1)));
    EXPECT_TRUE(is_being_recorded(folder_ / "r.csv.partial"));
  }
  EXPECT_TRUE(fs::exists(folder_ / "r.csv.partial"));
  EXPECT_FALSE(is_being_recorded(folder_ / "r.csv.partial"));
  EXPECT_FALSE(is_being_recorded(folder_ / "none"));
}

TEST_F(Recording, OnlyTheOwnerMayReadThem) {
  const mode_t mask = ::umask(0);
  csv_of(folder_, any_rows(1));
  EXPECT_EQ(fs::status(folder_ / "r.csv").permissions(), fs::perms(0600));
  // But one who has shared the file before does so again.
  fs::permissions(folder_ / "r.csv", fs::perms(0644));
  csv_of(folder_, any_rows(2));
  EXPECT_EQ(fs::status(folder_ / "r.csv").permissions(), fs::perms(0644));
  ::umask(mask);
}

TEST_F(Recording, AnExistingFileStaysWithoutACommitOrARow) {
  const std::string old = csv_of(folder_, any_rows(1));
  auto writer = RecordingWriter::open(folder_ / "r.csv");
  ASSERT_TRUE(writer);
  EXPECT_TRUE(writer->commit());
  EXPECT_EQ(text_of(folder_ / "r.csv"), old);
  EXPECT_EQ(files(), 1U) << "no partial file is left";
  {
    auto other = RecordingWriter::open(folder_ / "r.csv");
    ASSERT_TRUE(other);
    ASSERT_TRUE(other->append(any_rows(10)));
  }
  EXPECT_EQ(text_of(folder_ / "r.csv"), old);
}

TEST_F(Recording, OnlyARegularFileIsReplaced) {
  fs::create_directory(folder_ / "folder");
  fs::create_directory(folder_ / "r.csv.partial");
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  fs::create_symlink(folder_ / "pipe", folder_ / "link");
  for (const char* name : {"folder", "pipe", "link", "r.csv"}) {
    const auto writer = RecordingWriter::open(folder_ / name);
    ASSERT_FALSE(writer) << name;
    EXPECT_EQ(writer.error().code, ExitCode::kUnwritable);
  }
  EXPECT_TRUE(fs::is_fifo(folder_ / "pipe"));
  EXPECT_EQ(files(), 4U);
}

TEST_F(Recording, WriteFailuresAreReported) {
  const auto writer = RecordingWriter::open(folder_ / "no" / "r.csv");
  ASSERT_FALSE(writer);
  EXPECT_EQ(writer.error().code, ExitCode::kUnwritable);
  // A folder at the target's path, created before the rename.
  auto blocked = RecordingWriter::open(folder_ / "r.csv");
  fs::create_directory(folder_ / "r.csv");
  ASSERT_TRUE(blocked);
  ASSERT_TRUE(blocked->append(any_rows(1)));
  const auto committed = blocked->commit();
  ASSERT_FALSE(committed);
  EXPECT_EQ(committed.error().code, ExitCode::kUnwritable);
}

}  // namespace
}  // namespace trocar
