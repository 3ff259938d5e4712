// SPDX-License-Identifier: GPL-3.0-or-later
// Answers a C-STORE request, with which the other side sends one instance. The dataset goes from
// the network into an InstanceStore.
#pragma once

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmnet/dimse.h>

#include <functional>

#include "pipeline/archive/instance_file.h"

namespace trocar::archive {

struct StoreAnswer {
  OFCondition network = EC_Normal;  ///< state of the connection; if bad, the caller must abort it
  StoreOutcome outcome;             ///< valid if `network` is good
};

/// Receives the dataset that follows the request, stores it and sends the answer. `timeout_s` is
/// the longest wait for the next bytes. `stop` is called for each fragment of the dataset. If
/// `stop` returns true, or the dataset is more than twice as large as the store's limit for an
/// instance, receiving ends and `network` is bad. (A dataset between the limit and twice the limit
/// is received and refused, and the association goes on.)
StoreAnswer answer_store_request(T_ASC_Association& association,
                                 T_ASC_PresentationContextID context,
                                 const T_DIMSE_C_StoreRQ& request, InstanceStore& store,
                                 int timeout_s, const std::function<bool()>& stop = {});

/// Sends only the answer. Precondition: the caller has received or skipped the request's dataset.
OFCondition send_store_response(T_ASC_Association& association, T_ASC_PresentationContextID context,
                                const T_DIMSE_C_StoreRQ& request, StoreStatus status);

}  // namespace trocar::archive
