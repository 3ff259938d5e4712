// SPDX-License-Identifier: Apache-2.0
// The address at which the console serves OpenIGTLink clients.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "formats/base/result.h"

namespace trocar::runtime {

struct IgtlAddress {
  std::string address = "127.0.0.1";  ///< numerical IPv4 or IPv6 address
  std::uint16_t port = 0;             ///< 0: any free port
};
/// Reads an address of the form [ADDRESS:]PORT, in which an IPv6 address has brackets. Without
/// ADDRESS, the address is 127.0.0.1. Errors: kUsage if the text has another form.
Result<IgtlAddress> parse_igtl_address(std::string_view text);

}  // namespace trocar::runtime
