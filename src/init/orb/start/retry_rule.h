// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/orb.h"

#include "init/orb/map/attempt_types.h"

/// When a reference is worth another attempt.
namespace dsorb::init_orb {

/// Whether the last attempt from this reference, extrapolated by the growth of the parallax, tells
/// that the next one is refused unless the parallax is this much larger still.
bool refusedUnless(double larger,
                   const AttemptSummary& last,
                   double rotation_residual,
                   const GateOptions& gate);

/// Whether a start that passes should wait all the same: its rows move, and a few frames tell of
/// their motion little more than their neighbours let expect.
bool isYoung(const ReferenceView& view, double direction_sigma_deg);

/// Whether enough has changed since the last attempt from this reference: the predicted errors fall
/// as the rotation-compensated flow grows.
bool worthTheTime(const ReferenceView& view, double rotation_residual, const GateOptions& gate);

}  // namespace dsorb::init_orb
