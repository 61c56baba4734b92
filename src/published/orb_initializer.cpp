// SPDX-License-Identifier: BSD-3-Clause
#include "published/orb_initializer.h"

#include "dsorb/error.h"
#include "dsorb/init/metric_scale.h"
#include "dsorb/init/registry.h"
#include "dsorb/published/registration.h"

#include "base/median.h"
#include "image/contrast.h"
#include "init/result.h"
#include "published/bundle_adjustment.h"
#include "published/photometric.h"
#include "published/structure.h"
#include "published/two_view.h"
#include "two_view/model_selection.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::published {
namespace {

constexpr std::size_t kMinPoints = 50;  // semi-dense ones; fewer: the attempt fails
constexpr int kMinRotationTracks = 10;  // needed to tell that a rotation explains them
constexpr int kMaxBlank = 3;            // frames in a row that are passed over

/// Hands over the points that are in front and have a variance.
InitializationResult toResult(Map map, InitReport report) {
  InitializationResult result;
  for (const Observation& seen : map.observations) ++map.points[seen.corner].observations;
  std::vector<double> sigmas;
  for (const MapPoint& point : map.points) {
    const auto inverse_depth = static_cast<float>(point.inverse_depth);
    const auto variance = static_cast<float>(point.variance);
    if (!std::isfinite(inverse_depth + variance) || !(std::min(inverse_depth, variance) > 0)) {
      continue;
    }
    result.points.push_back({0, point.pixel, inverse_depth, variance, point.observations});
    sigmas.push_back(std::sqrt(variance) / inverse_depth);
  }
  result.frames = std::move(map.frames);
  result.report = std::move(report);
  result.report.add("corners", static_cast<double>(map.corners));
  result.report.median_relative_sigma = medianOf(std::move(sigmas));
  normalizeScale(result);
  const FramePriors* priors = result.frames.front().frame->priors();
  if (priors != nullptr && priors->depth && priors->depth->metric) {
    result.metric = scaleFromDepth(result, *priors->depth);
  }
  if (!result.metric) result.metric = scaleFromDistances(result);
  return result;
}

InitializerFactory factoryOf(Version version) {
  return [version](const InitializerOptions& options, const PinholeCamera& camera) {
    const PublishedOptions& o = options.published;
    if (o.min_frames > o.max_frames) {
      throw ConfigError("option published.min_frames = " + std::to_string(o.min_frames) +
                        " is more than published.max_frames = " + std::to_string(o.max_frames));
    }
    return std::make_unique<ORBInitializer>(version, options, camera);
  };
}

}  // namespace

void registerInitializers() {
  const auto& [v1, v2, v3, matching] = kPublishedVariants;
  static const RegisteredInitializer first(v1, factoryOf(Version::kV1));
  static const RegisteredInitializer second(v2, factoryOf(Version::kV2));
  static const RegisteredInitializer third(v3, factoryOf(Version::kV3));
  static const RegisteredInitializer fourth(matching, factoryOf(Version::kMatching));
}

ORBInitializer::ORBInitializer(Version version,
                               const InitializerOptions& options,
                               const PinholeCamera& camera)
    : version_(version),
      options_(options),
      camera_(camera),
      arena_(options.num_threads),
      frame_check_(camera),
      features_(options.published.max_corners, version == Version::kMatching) {}

InitStep ORBInitializer::addFrame(FramePtr frame) {
  if (spent_) throw std::logic_error("addFrame after a result: call reset() first");
  frame_check_.accept(frame);
  return arena_.run([&] { return trackFrame(std::move(frame)); });
}

void ORBInitializer::reset() {
  clock_.clear();
  resets_.clear();
  frame_check_.restart();
  age_ = blank_ = 0;
  spent_ = false;
}

/// Algorithm 1.
InitStep ORBInitializer::trackFrame(FramePtr frame) {
  if (age_ == 0) return resetRefFrame(std::move(frame), needsMoreFrames(InitReason::kFirstFrame));
  if (age_ == 1 && features_.size() < options_.published.min_tracked) {
    return resetRefFrame(std::move(frame), needsMoreFrames(InitReason::kTooFewPoints));
  }
  if (blank_ < kMaxBlank && isBlank(*frame, *features_.frames().back())) {
    ++blank_;
    return needsMoreFrames(InitReason::kTooFewPoints);
  }
  blank_ = 0;
  ++age_;
  const int num_successful = clock_.time("tracking", [&] { return features_.track(frame); });
  features_.keepWithin(options_.max_waiting_mb);
  if (num_successful < options_.published.min_tracked || features_.cut()) {
    return resetRefFrame(std::move(frame),
                         onlyRotated() ? needsMoreFrames(InitReason::kTooLittleParallax)
                                       : resets_.restart(InitReason::kTrackingLost));
  }
  const InitReason reason =
      age_ < options_.published.min_frames ? InitReason::kSettling : initialize();
  if (reason != InitReason::kDone) return failure(std::move(frame), reason);
  spent_ = true;
  return resets_.finish(toResult(std::move(map_), std::move(report_)), clock_);
}

/// The rest of algorithm 1, from computeRelativeTransform on.
/// @return kDone, or why there is no start
InitReason ORBInitializer::initialize() {
  report_ = {};
  const InitReason reason = computeRelativeTransform();
  if (reason != InitReason::kDone) return reason;
  if (!performGeometricBA()) return InitReason::kPoorQuality;
  const auto seed = static_cast<std::uint64_t>(options_.seed);
  clock_.time("semi_dense", [&] { populateStructure3D(map_, camera_, seed); });
  if (map_.points.size() - map_.corners < kMinPoints) return InitReason::kTooFewPoints;
  if (!performGeometricBA()) return InitReason::kPoorQuality;
  if (version_ == Version::kV1 || version_ == Version::kMatching) return InitReason::kDone;
  return performPhotometricBAs() ? InitReason::kDone : InitReason::kPoorQuality;
}

InitReason ORBInitializer::computeRelativeTransform() {
  const CornerTracks tracks = features_.tracks();
  const Matches matches = tracks.matchesTo(tracks.frames() - 1);
  const bool matching = version_ == Version::kMatching;
  if (matching) report_.add("optical_flow", features_.usesFlow() ? 1 : 0);
  const double parallax_deg =
      clock_.time("two_view", [&] { return rotationResidualDeg(matches, camera_); });
  report_.add("parallax_deg", parallax_deg);
  if (parallax_deg < kMinRotationResidualDeg) return InitReason::kTooLittleParallax;
  const ModelChoice choice = matching ? ModelChoice::kInliers : ModelChoice::kScore;
  const auto seed = static_cast<std::uint64_t>(options_.seed);
  const RelativeMotion motion =
      clock_.time("two_view", [&] { return estimateMotion(matches, camera_, choice, seed); });
  if (motion.reason != InitReason::kDone) return motion.reason;
  report_.model = motion.model == Model::kHomography ? "homography" : "fundamental";
  report_.add("tracks", static_cast<double>(matches.size()));
  map_ = clock_.time("pose",
                     [&] { return makeMap(features_.frames(), tracks, motion.best, camera_); });
  return InitReason::kDone;
}

bool ORBInitializer::performGeometricBA() {
  const GeometricReport report =
      clock_.time("geometric", [&] { return adjustGeometry(map_, camera_); });
  report_.add("residual_rms", report.residual_rms);
  return report.usable;
}

bool ORBInitializer::performPhotometricBAs() {
  const auto adjust = [&] {
    return clock_.time("photometric", [&] { return performPhotometricBA(map_, camera_); });
  };
  if (!adjust()) return false;
  if (version_ == Version::kV3) {
    clock_.time("filter", [&] { removeOutliers(map_, camera_); });
    if (!adjust()) return false;
  }
  return true;
}

InitStep ORBInitializer::resetRefFrame(FramePtr frame, InitStep step) {
  clock_.time("corners", [&] { features_.start(std::move(frame)); });
  age_ = 1;
  return step;
}

/// The thesis leaves open when a reference without a start is given up: after max_frames, and with
/// descriptors, where a pair of frames stands alone, at any failure but too little parallax.
InitStep ORBInitializer::failure(FramePtr frame, InitReason reason) {
  const bool waits = reason == InitReason::kTooLittleParallax;
  const bool expired = age_ >= options_.published.max_frames;
  const bool alone = version_ == Version::kMatching && reason != InitReason::kSettling;
  if (!expired && (!alone || waits)) return needsMoreFrames(reason);
  if (waits) return resetRefFrame(std::move(frame), needsMoreFrames(reason));
  return resetRefFrame(std::move(frame), resets_.restart(alone ? reason : InitReason::kTimeout));
}

/// Whether the corners left the image only because the camera rotated.
bool ORBInitializer::onlyRotated() const {
  if (features_.cut()) return false;
  const CornerTracks tracks = features_.tracks();
  return tracks.size() >= kMinRotationTracks &&
         rotationResidualDeg(tracks.matchesTo(tracks.frames() - 1), camera_) <
             kMinRotationResidualDeg;
}

}  // namespace dsorb::published
