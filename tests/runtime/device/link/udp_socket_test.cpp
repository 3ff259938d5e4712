// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/link/udp_link.h"

#include <gtest/gtest.h>

namespace trocar::runtime {
namespace {

TEST(Endpoint, ParsesHostAndPort) {
  const auto good = parse_endpoint("127.0.0.1:4840", 1);
  ASSERT_TRUE(good);
  EXPECT_EQ(*good, (Endpoint{0x7f000001, 4840}));
  EXPECT_TRUE(good->is_loopback());
  EXPECT_EQ(to_string(*good), "127.0.0.1:4840");
  EXPECT_TRUE(parse_endpoint("localhost:1", 1)->is_loopback());
  EXPECT_FALSE(parse_endpoint("192.0.2.1:9", 1)->is_loopback());
  EXPECT_TRUE(parse_endpoint("127.0.0.1:0", 0));
  for (const char* bad :
       {"", ":", "127.0.0.1", "127.0.0.1:", ":4840", "127.0.0.1:0", "127.0.0.1:65536",
        "127.0.0.1:-1", "127.0.0.1:4840x", "127.0.0.1: 1", "300.0.0.1:1"}) {
    const auto refused = parse_endpoint(bad, 1);
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ(refused.error().code, ExitCode::kUsage);
  }
  const auto taken = UdpSocket::listen({0x7f000001, 0});
  ASSERT_TRUE(taken);
  const auto twice = UdpSocket::listen(taken->local());
  ASSERT_FALSE(twice);
  EXPECT_EQ(twice.error().code, ExitCode::kUnwritable);
}

}  // namespace
}  // namespace trocar::runtime
