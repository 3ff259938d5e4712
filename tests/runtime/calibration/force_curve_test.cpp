// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/force_curve.h"

#include <gtest/gtest.h>

#include <functional>

#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

/// A curve of `rows` rows with a depth and a force for each.
std::string csv(int rows, const std::function<double(int)>& depth_mm,
                const std::function<double(int)>& force_N) {
  std::string text = "depth_mm,force_N\n";
  for (int i = 0; i < rows; ++i)
    text += text_line("%.6g,%.6g\n", depth_mm(i), force_N(i));
  return text;
}

double tenth(int i) {
  return 0.1 * i;
}

std::string refusal(const std::string& text) {
  const Result<ForceCurve> curve = parse_force_curve(text, "c.csv");
  if (curve) return "accepted";
  EXPECT_EQ(curve.error().code, ExitCode::kRefused);
  EXPECT_EQ(curve.error().message.find('\n'), std::string::npos);
  return curve.error().message;
}

TEST(ForceCurve, InsertionAndWithdrawal) {
  const auto text = csv(
      61, [](int i) { return i <= 40 ? 0.1 * i : 8 - 0.1 * i; }, tenth);
  const Result<ForceCurve> curve = parse_force_curve(text, "c.csv");
  ASSERT_TRUE(curve) << curve.error().message;
  EXPECT_EQ(curve->insertion.size(), 41U);
  EXPECT_EQ(curve->withdrawal.size(), 20U);
  EXPECT_DOUBLE_EQ(curve->insertion[3].depth_mm, 0.3);
}

TEST(ForceCurve, ColumnsInAnyOrderAndOtherSeparators) {
  std::string text =
      "\xEF\xBB\xBF"
      "force_N; speed_mm_per_s; depth_mm\r\n";
  for (int i = 0; i < 40; ++i)
    text += text_line("%d;2;%+.2f\r\n", i, 0.1 * i);
  const Result<ForceCurve> curve = parse_force_curve(text + "\r\n", "c.csv");
  ASSERT_TRUE(curve) << curve.error().message;
  EXPECT_EQ(curve->insertion.size(), 40U);
  EXPECT_DOUBLE_EQ(curve->insertion[10].force_N, 10);
  EXPECT_DOUBLE_EQ(curve->high_speed_mm_per_s, 2);
}

TEST(ForceCurve, WrongColumns) {
  EXPECT_EQ(refusal(""), "c.csv: is empty");
  const std::string columns =
      "c.csv: line 1: the first line must name the columns depth_mm and force_N, and may name "
      "speed_mm_per_s and time_s";
  EXPECT_EQ(refusal("1,2\n"), columns);
  EXPECT_EQ(refusal("depth_mm,force_kN\n"), columns);
  EXPECT_EQ(refusal("depth_mm\n"), columns);
  EXPECT_EQ(refusal(std::string(1'000'000, ',')), columns);
  EXPECT_EQ(refusal("depth_mm,force_N,force_N\n"),
            "c.csv: line 1: the column force_N occurs twice");
  EXPECT_EQ(refusal("depth_mm,force_N\n"), "c.csv: has no row of numbers");
}

TEST(ForceCurve, WrongNumbers) {
  const std::string head = "depth_mm,force_N\n0,0\n";
  EXPECT_EQ(refusal(head + "a,1\n"), "c.csv: line 3: depth_mm is not a number");
  EXPECT_EQ(refusal(head + "1,\n"), "c.csv: line 3: force_N is not a number");
  EXPECT_EQ(refusal(head + "1,nan\n"), "c.csv: line 3: force_N is not finite");
  EXPECT_EQ(refusal(head + "inf,1\n"), "c.csv: line 3: depth_mm is not finite");
  EXPECT_EQ(refusal(head + "1,1e400\n"), "c.csv: line 3: force_N is not a number");
  EXPECT_EQ(refusal(head + "1,2e5\n"), "c.csv: line 3: force_N is beyond 100000");
  EXPECT_EQ(refusal(head + "1,2,3\n"), "c.csv: line 3: must have 2 fields");
  EXPECT_EQ(refusal(head + "1;2\n"), "c.csv: line 3: must have 2 fields");
}

TEST(ForceCurve, WrongCurves) {
  EXPECT_EQ(refusal(csv(10, tenth, tenth)), "c.csv: has 10 rows, and must have at least 20");
  EXPECT_EQ(refusal(csv(50, tenth, [](int) { return 3; })), "c.csv: force_N is 3 in all rows");
  EXPECT_EQ(
      refusal(csv(
          50, [](int i) { return 1e-4 * i; }, tenth)),
      "c.csv: depth_mm grows by 0.0049 only, and must grow by at least 1 mm; is it in metres?");
  EXPECT_EQ(refusal(csv(
                50, [](int i) { return 100.0 * i; }, tenth)),
            "c.csv: depth_mm grows by 4900, and must not grow by more than 500 mm; is it in um?");
  EXPECT_EQ(refusal(csv(
                50, [](int i) { return -0.1 * i; }, tenth)),
            "c.csv: depth_mm never grows; it must grow while the tool moves in");
  EXPECT_EQ(
      refusal(csv(
          90, [](int i) { return 0.1 * i * (i % 2); }, tenth)),
      "c.csv: depth_mm goes back and forth; a curve has one insertion and at most one withdrawal");
}

TEST(ForceCurve, HugeFiles) {
  std::string rows = "depth_mm,force_N\n";
  for (std::size_t i = 0; i <= kMaxCurveRows; ++i)
    rows += "1,2\n";
  EXPECT_EQ(refusal(rows), "c.csv: has more than 200000 rows");
  EXPECT_EQ(refusal(std::string(kMaxCurveBytes + 1, ' ')), "c.csv: is larger than 16777216 bytes");
  EXPECT_FALSE(read_force_curve("/dev/null"));
  EXPECT_FALSE(read_force_curve("no such file"));
}

}  // namespace
}  // namespace trocar::runtime
