// SPDX-License-Identifier: Apache-2.0
// The HTTP interface, as far as a client of the arm needs it: GET /version, GET /devices, and the force gate's gain by
// GET, POST and DELETE /{device_type}/{id_or_index}/config/filters/force_gate?session=... in version 3.5.
#pragma once

#include <string>
#include <string_view>

#include "tests/stand_ins/haply/service.h"

namespace trocar::haply_stand_in {

struct HttpAnswer {
  unsigned status = 200;
  std::string body;  // JSON
};

/// Never throws for what a client sends.
HttpAnswer answer_http(Service& service, std::string_view method, std::string_view target,
                       std::string_view body);

}  // namespace trocar::haply_stand_in
