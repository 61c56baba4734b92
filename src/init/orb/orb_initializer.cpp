// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/orb_initializer.h"

#include "init/orb/geometric_adjustment.h"
#include "init/orb/map_assembly.h"
#include "init/orb/motion_hypotheses.h"
#include "init/orb/rotation_only.h"
#include "init/orb/semi_dense_depth.h"

#include <cmath>
#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kDegPerRad = 180.0 / M_PI;
constexpr int kMinRotationTracks = 10;   // to tell that a rotation explains them all
constexpr std::size_t kKeptResets = 32;  // reasons kept; a camera may stand in the dark for hours

InitStep needsMoreFrames(InitReason reason) {
  return {InitStatus::kNeedsMoreFrames, reason, std::nullopt};
}

Matches matchesOf(const FeatureTracks& tracks) {
  Matches matches;
  const int newest = tracks.frames() - 1;
  for (std::size_t i = 0; i < static_cast<std::size_t>(tracks.size()); ++i) {
    matches.reference.emplace_back(tracks.positions(0)[i].cast<double>());
    matches.target.emplace_back(tracks.positions(newest)[i].cast<double>());
  }
  return matches;
}

void describeMotion(const TwoViewMotion& motion, std::size_t matches, InitReport& report) {
  report.model = motion.model == TwoViewModel::kHomography ? "homography" : "fundamental";
  report.inlier_ratio = static_cast<double>(motion.inliers) / static_cast<double>(matches);
  report.details.emplace_back("tracks", static_cast<double>(matches));
  report.details.emplace_back("score_homography", motion.homography_score);
  report.details.emplace_back("score_fundamental", motion.fundamental_score);
  report.details.emplace_back("model_inliers", motion.inliers);
  report.details.emplace_back("good_points", motion.best.good);
  report.details.emplace_back("good_points_of_second_motion", motion.second_good);
  report.details.emplace_back("ranked_parallax_deg", motion.best.parallax_deg);
}

}  // namespace

ORBInitializer::ORBInitializer(const InitializerOptions& options, const PinholeCamera& camera)
    : options_(options),
      camera_(camera),
      arena_(options.num_threads),
      tracks_(options.orb.tracks) {}

InitStep ORBInitializer::addFrame(FramePtr frame) {
  if (spent_) throw std::logic_error("addFrame after a result: call reset() first");
  if (!frame) throw std::invalid_argument("addFrame without a frame");
  checkFrame(*frame);
  if (last_timestamps_.size() == 2) last_timestamps_.erase(last_timestamps_.begin());
  last_timestamps_.push_back(frame->timestamp());
  return arena_.run([&] { return advance(std::move(frame)); });
}

void ORBInitializer::reset() {
  tracks_.clear();
  frames_.clear();
  clock_.clear();
  restarts_ = 0;
  earlier_resets_.clear();
  last_timestamps_.clear();
  spent_ = false;
}

void ORBInitializer::checkFrame(const Frame& frame) const {
  if (frame.width() != camera_.width || frame.height() != camera_.height) {
    throw std::invalid_argument("frame of " + std::to_string(frame.width()) + "x" +
                                std::to_string(frame.height()) + " pixels, the camera has " +
                                std::to_string(camera_.width) + "x" +
                                std::to_string(camera_.height));
  }
  if (last_timestamps_.empty()) return;
  const double step = frame.timestamp() - last_timestamps_.back();
  const double earlier_step = last_timestamps_.back() - last_timestamps_.front();
  if (!(step * earlier_step >= 0) || step == 0) {
    throw std::invalid_argument("timestamp " + std::to_string(frame.timestamp()) + " after " +
                                std::to_string(last_timestamps_.back()) +
                                ": equal, or the direction of time has changed");
  }
}

/// Whether the tracks left the image because the camera turned: nothing is lost then.
bool ORBInitializer::onlyRotated() const {
  if (tracks_.size() < kMinRotationTracks ||
      tracks_.survivorShare() < options_.orb.tracks.min_survivor_share) {
    return false;
  }
  return rotationResidualDeg(matchesOf(tracks_)) < options_.orb.two_view.min_rotation_residual_deg;
}

double ORBInitializer::rotationResidualDeg(const Matches& matches) const {
  return std::atan(fitRotation(matches, camera_).median_residual / camera_.fx) * kDegPerRad;
}

/// One step of algorithm 1.
InitStep ORBInitializer::advance(FramePtr frame) {
  if (frames_.empty()) {
    takeReference(std::move(frame));
    return needsMoreFrames(InitReason::kFirstFrame);
  }
  if (tracks_.size() < options_.orb.min_tracked) {
    return waitWithNewReference(std::move(frame), InitReason::kTooFewPoints);
  }
  clock_.time("tracking", [&] { tracks_.advance(*frame); });
  if (tracks_.size() < options_.orb.min_tracked ||
      tracks_.survivorShare() < options_.orb.tracks.min_survivor_share) {
    return onlyRotated() ? waitWithNewReference(std::move(frame), InitReason::kTooLittleParallax)
                         : restart(std::move(frame), InitReason::kTrackingLost);
  }
  frames_.push_back(frame);
  if (tracks_.frames() < options_.orb.min_frames) return needsMoreFrames(InitReason::kSettling);

  Attempt made = attempt();
  if (made.map) return finish(std::move(made));
  if (tracks_.frames() < options_.orb.max_frames) return needsMoreFrames(made.reason);
  return made.reason == InitReason::kTooLittleParallax
             ? waitWithNewReference(std::move(frame), made.reason)
             : restart(std::move(frame), InitReason::kTimeout);
}

ORBInitializer::Attempt ORBInitializer::attempt() {
  const Matches matches = matchesOf(tracks_);
  Attempt attempt;
  attempt.report.median_parallax_deg =
      clock_.time("two_view", [&] { return rotationResidualDeg(matches); });
  if (attempt.report.median_parallax_deg < options_.orb.two_view.min_rotation_residual_deg) {
    attempt.reason = InitReason::kTooLittleParallax;
    return attempt;
  }
  buildMap(matches, attempt);
  return attempt;
}

void ORBInitializer::buildMap(const Matches& matches, Attempt& attempt) {
  const OrbOptions& orb = options_.orb;
  const auto seed = static_cast<std::uint64_t>(options_.seed);
  const TwoViewMotion motion =
      clock_.time("two_view", [&] { return estimateMotion(matches, camera_, orb.two_view, seed); });
  attempt.reason = motion.reason;
  if (motion.reason != InitReason::kDone) return;
  describeMotion(motion, matches.size(), attempt.report);

  InitialMap map = makeInitialMap(frames_, tracks_, motion.best);
  clock_.time("pose", [&] { poseFramesBetween(map, camera_, orb.two_view.sigma); });
  const auto adjust = [&] {
    return clock_.time("geometric", [&] { return adjustGeometry(map, camera_, orb.geometric); });
  };
  attempt.reason = InitReason::kPoorQuality;
  const GeometricReport first = adjust();
  if (!first.usable) return;
  const SemiDenseReport semi_dense = clock_.time(
      "semi_dense", [&] { return estimateSemiDenseDepth(map, camera_, orb.semi_dense, seed); });
  const GeometricReport second = adjust();
  if (!second.usable) return;

  attempt.reason = InitReason::kDone;
  attempt.report.residual_rms = second.residual_rms;
  attempt.report.details.emplace_back("corners", static_cast<double>(map.corners.size()));
  attempt.report.details.emplace_back("removed_severe",
                                      first.removed_severe + second.removed_severe);
  attempt.report.details.emplace_back("removed_normal",
                                      first.removed_normal + second.removed_normal);
  attempt.report.details.emplace_back("semi_dense_candidates", semi_dense.candidates);
  attempt.report.details.emplace_back("semi_dense_points", semi_dense.points);
  attempt.map = std::move(map);
}

InitStep ORBInitializer::finish(Attempt attempt) {
  InitializationResult result = toResult(*attempt.map);
  InitReport& report = result.report;
  report.model = attempt.report.model;
  report.median_parallax_deg = attempt.report.median_parallax_deg;
  report.inlier_ratio = attempt.report.inlier_ratio;
  report.residual_rms = attempt.report.residual_rms;
  report.details = std::move(attempt.report.details);
  report.restarts = restarts_;
  report.earlier_resets = earlier_resets_;
  report.stages = clock_.stages();
  checkInvariants(result);
  spent_ = true;
  return {InitStatus::kInitialized, InitReason::kDone, std::move(result)};
}

void ORBInitializer::takeReference(FramePtr frame) {
  clock_.time("tracking", [&] { tracks_.start(*frame); });
  frames_.clear();
  frames_.push_back(std::move(frame));
}

InitStep ORBInitializer::waitWithNewReference(FramePtr frame, InitReason reason) {
  takeReference(std::move(frame));
  return needsMoreFrames(reason);
}

InitStep ORBInitializer::restart(FramePtr frame, InitReason reason) {
  ++restarts_;
  if (earlier_resets_.size() == kKeptResets) earlier_resets_.erase(earlier_resets_.begin());
  earlier_resets_.push_back(reason);
  takeReference(std::move(frame));
  return {InitStatus::kRestarted, reason, std::nullopt};
}

}  // namespace dsorb::init_orb
