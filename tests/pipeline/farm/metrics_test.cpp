// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/metrics.h"

#include <gtest/gtest.h>

namespace trocar::farm {
namespace {

TEST(Metrics, AreGaugesWithTheStoreAsLabel) {
  BatchSummary summary;
  summary.scans = 21;
  summary.unchanged = 1;
  summary.made = 2;
  summary.found = 3;
  summary.left = 4;
  summary.failed.resize(5);
  summary.known.resize(6);
  summary.asset_bytes = 7'000'000'000;
  summary.seconds = 8.25;
  const auto end =
      std::chrono::system_clock::time_point(std::chrono::milliseconds(1'700'000'000'500));
  EXPECT_EQ(metrics_text(summary, "/farm/a \"b\"\\c\n", end),
            R"(# HELP trocar_batch_scans Scans of the last run, each in one class.
# TYPE trocar_batch_scans gauge
trocar_batch_scans{store="/farm/a \"b\"\\c\n",class="unchanged"} 1
trocar_batch_scans{store="/farm/a \"b\"\\c\n",class="made"} 2
trocar_batch_scans{store="/farm/a \"b\"\\c\n",class="found"} 3
trocar_batch_scans{store="/farm/a \"b\"\\c\n",class="failed"} 5
trocar_batch_scans{store="/farm/a \"b\"\\c\n",class="known_failure"} 6
trocar_batch_scans{store="/farm/a \"b\"\\c\n",class="left"} 4
# HELP trocar_batch_asset_bytes Size of the assets of those scans of the last run that are done.
# TYPE trocar_batch_asset_bytes gauge
trocar_batch_asset_bytes{store="/farm/a \"b\"\\c\n"} 7000000000
# HELP trocar_batch_duration_seconds Duration of the last run.
# TYPE trocar_batch_duration_seconds gauge
trocar_batch_duration_seconds{store="/farm/a \"b\"\\c\n"} 8.250
# HELP trocar_batch_end_timestamp_seconds Unix time at which the last run ended; time() minus this value is its age.
# TYPE trocar_batch_end_timestamp_seconds gauge
trocar_batch_end_timestamp_seconds{store="/farm/a \"b\"\\c\n"} 1700000000.500
)");
}

}  // namespace
}  // namespace trocar::farm
