// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/orb_initializer.h"

#include "dsorb/init/metric_scale.h"

#include "base/median.h"
#include "base/parallel.h"
#include "image/contrast.h"
#include "image/frame_check.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/first_window.h"
#include "init/orb/left_out_tracks.h"
#include "init/orb/reference_pool.h"
#include "init/orb/start/essential_start.h"
#include "init/orb/start/readout.h"
#include "init/reset_log.h"
#include "init/result.h"
#include "two_view/model_selection.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// Fills the start up with points, leaving out regions that contradict the motion.
Outcome<Reconstruction> addPoints(Reconstruction made,
                                  const ReferenceView& view,
                                  const AttemptContext& context) {
  if (context.options.skip.has(Mechanism::kDynamic)) {
    return fillFirstWindow(std::move(made), context);
  }
  std::optional<DynamicRegions> dynamic;
  context.clock.time("dynamic", [&] { dynamic.emplace(made.map, view.tracks, context.camera); });
  dynamic->removeFrom(made.map);
  auto filled = fillFirstWindow(std::move(made), context);
  if (filled) dynamic->removeFrom(filled->map);
  return filled;
}

/// Judges the errors anew of a map that has lost corners to dynamic regions and to neighbours that
/// contradict them, and refuses it where it is not sure any more.
/// @param passed judgement before
Outcome<Reconstruction> refuseRemains(Reconstruction made,
                                      const GateReport& passed,
                                      const GateOptions& options) {
  if (!hasEnoughCorners(made.map, made.live)) return InitReason::kTooFewPoints;
  const double shrunk_by = passed.lost_factor / lostTracksFactor(made.map, made.live);
  if (!errorsPass(passed, shrunk_by, options)) return InitReason::kPoorQuality;
  made.report.wrong_probability = wrongProbability(passed, shrunk_by, options);
  return made;
}

/// Poses the frames that had no part in the adjustments; their brightness is left to the window.
/// Their covariances are those of their own corners' errors. The depths' are not in them: squared
/// errors are up to 1.5 times as large as they say.
Outcome<Reconstruction> poseOtherFrames(Reconstruction made, const AttemptContext& context) {
  InitialMap& map = made.map;
  context.clock.time("pose", [&] {
    const std::vector<std::size_t> frames = poseOtherFrames(map, context.camera);
    const auto observations = observationsByFrame(map, context.camera);
    for (const std::size_t frame : frames) {
      PosedFrame& posed = map.frames[frame];
      posed.covariance = poseCovariance(observations[frame],
                                        context.camera,
                                        *posed.T_cam_ref,
                                        {kTrackSigma, map.cluster_variance_scale});
    }
  });
  return made;
}

/// Refuses a start with a rival, while most of its tracks live: where an object keeps its distance,
/// the world's are lost first.
Outcome<Reconstruction> refuseRivalled(Reconstruction made,
                                       const EarlyMatches& early,
                                       const AttemptContext& context) {
  const auto& frames = made.map.frames;
  const auto posed = std::find_if(frames.begin(), frames.end(), [&](const PosedFrame& candidate) {
    return candidate.frame->id() == early.frame && candidate.T_cam_ref;
  });
  const bool rivalled = posed != frames.end() && context.clock.time("dynamic", [&] {
    return hasRival(*posed->T_cam_ref, early.matches, context.camera, context.seed());
  });
  if (rivalled) return InitReason::kDegenerateMotion;
  return made;
}

double medianRelativeSigma(const std::vector<InitPoint>& points) {
  std::vector<double> sigmas;
  sigmas.reserve(points.size());
  for (const InitPoint& point : points) {
    sigmas.push_back(std::sqrt(point.variance) / point.inverse_depth);
  }
  return medianOf(std::move(sigmas));
}

constexpr int kMinRotationTracks = 10;  // needed to tell that a rotation explains them
constexpr int kMaxAttempts = 2;         // with one frame
/// Frames in a row that are passed over because they show nothing: without this starts with two of
/// them take 1.05 +- .01 times as many images.
constexpr int kMaxBlank = 3;
constexpr int kMaxPutOff = 10;  // attempts in a row, of a caller who is always in a hurry

void keepSurest(const std::optional<WaitingMotion>& motion, std::optional<WaitingMotion>& surest) {
  if (!motion) return;
  if (!surest || motion->wrong_probability < surest->wrong_probability) surest = motion;
}

ReferencePool makePool(const InitializerOptions& options) {
  OrbOptions orb = options.orb;
  if (options.skip.has(Mechanism::kPool)) orb.reference_interval = 0;
  return {orb, options.max_waiting_mb, options.skip.has(Mechanism::kFar)};
}

/// The hand-over, in the common unit, without points at or behind infinity. The caller fills in
/// counts, restarts and stages of the report.
InitializationResult toResult(Reconstruction made) {
  InitializationResult result;
  result.points = pointsOf(made.map);
  result.frames = std::move(made.map.frames);
  result.report = std::move(made.report);
  result.readout = made.map.readout;
  result.stuck = std::move(made.map.stuck);
  normalizeScale(result);
  const FramePriors* priors = result.frames.front().frame->priors();
  const bool contradicted = made.depth_prior && made.depth_prior->contradicted;
  if (priors != nullptr && priors->depth && priors->depth->metric && !contradicted) {
    result.metric = scaleFromDepth(result, *priors->depth);
  }
  if (!result.metric) result.metric = scaleFromDistances(result);
  result.report.median_relative_sigma = medianRelativeSigma(result.points);
  return result;
}

}  // namespace

Attempt attemptFrom(ReferenceView seen, const AttemptContext& context) {
  using Made = Reconstruction;
  const Skips& skip = context.options.skip;
  const int shown = seen.tracks.size();
  std::vector<Eigen::Vector2f> stuck;
  if (!skip.has(Mechanism::kStuck)) {
    stuck = context.clock.time(
        "stuck", [&] { return leaveOutStuck(seen.tracks, context.camera, context.seed()); });
  }
  if (!skip.has(Mechanism::kEdges)) leaveOutEdges(seen.frames.front()->level(0), seen.tracks);
  const Readout calibrated = readoutOf(*seen.frames.front());
  ReferenceView view = withGlobalShutter(seen, calibrated);
  Attempt start = startFromEssential(view, context);
  if (calibrated.sigma > 0 && start.summary.tried &&
      !skip.has(Mechanism::kReadoutProfile)) {  // this frame is worth it
    const Readout found =
        context.clock.time("readout", [&] { return profileReadout(seen, context); });
    if (found.seconds != calibrated.seconds) {
      view = withGlobalShutter(seen, found);
      view.last = {};
      start = startFromEssential(view, context);
    }
  }
  if (start.made) {
    start.made->map.stuck = stuck;
    start.made->report.add("stuck_tracks", static_cast<double>(stuck.size()));
  }
  auto made =
      std::move(start.made)
          .then([&](Made m) { return addPoints(std::move(m), view, context); })
          .then([&](Made m) {
            return refuseRemains(std::move(m), *start.summary.gate, context.options.orb.gate);
          })
          .then([&](Made m) { return poseOtherFrames(std::move(m), context); });
  // Early matches are as the images show them, with those on bonnets, logos and edges.
  const bool comparable = seen.tracks.size() == shown && !view.readout;
  if (made && comparable && !skip.has(Mechanism::kDynamic)) {
    made = refuseRivalled(std::move(*made), view.early, context);
  }
  start.summary.reason = made.reason();
  if (made) made->report.add("corners", static_cast<double>(made->map.corners.size()));
  return {std::move(made), start.summary, start.motion};
}

namespace {

/// Initializer from corners: motion between a reference and the newest frame, geometric adjustment
/// of the frames since the reference, semi-dense inverse depth of the reference.
/// @source [Gladkova], algorithm 1 (full reference: docs/references.md)
class ORBInitializer final : public Initializer {
 public:
  ORBInitializer(const InitializerOptions& options, const PinholeCamera& camera)
      : options_(options),
        camera_(camera),
        arena_(options.num_threads),
        frame_check_(camera),
        pool_(makePool(options)) {}

  [[nodiscard]] InitStep addFrame(FramePtr frame) override {
    if (spent_) throw std::logic_error("addFrame after a result: call reset() first");
    frame_check_.accept(frame);
    return arena_.run([&] { return advance(std::move(frame)); });
  }

  void reset() override {
    pool_.clear();
    clock_.clear();
    resets_.clear();
    frame_check_.restart();
    spent_ = false;
    blank_ = 0;
    put_off_ = 0;
  }

  void setHurried(bool hurried) override { hurried_ = hurried; }

 private:
  InitStep advance(FramePtr frame) {
    if (pool_.empty()) {
      return startOver(std::move(frame), needsMoreFrames(InitReason::kFirstFrame));
    }
    if (pool_.tooFewCorners()) {
      return startOver(std::move(frame), needsMoreFrames(InitReason::kTooFewPoints));
    }
    if (!options_.skip.has(Mechanism::kBlank) && blank_ < kMaxBlank &&
        isBlank(*frame, pool_.newest())) {
      ++blank_;
      return needsMoreFrames(InitReason::kTooFewPoints);
    }
    blank_ = 0;
    clock_.time("tracking", [&] { pool_.advance(frame); });
    if (pool_.dropLost()) {
      return startOver(std::move(frame),
                       onlyRotated() ? needsMoreFrames(InitReason::kTooLittleParallax)
                                     : resets_.restart(InitReason::kTrackingLost));
    }
    Attempt attempt = tryReferences();
    if (attempt.made) {
      InitStep started = resets_.finish(toResult(std::move(*attempt.made)), clock_);
      spent_ = true;
      return started;
    }
    const InitReason failure = attempt.made.reason();
    if (const auto reason = pool_.giveUp(failure)) {
      return startOver(std::move(frame),
                       *reason == InitReason::kTooLittleParallax ? needsMoreFrames(*reason)
                                                                 : resets_.restart(*reason));
    }
    clock_.time("corners", [&] { pool_.addWhenDue(); });
    InitStep step = needsMoreFrames(failure);
    step.motion = attempt.motion;
    return step;
  }

  /// Tries the references, oldest first, until one passes.
  Attempt tryReferences() {
    Attempt first;  // its reason is the answer when none succeeds
    if (hurried_ && put_off_ < kMaxPutOff) {
      ++put_off_;
      first.made = InitReason::kHurried;
      return first;
    }
    put_off_ = 0;
    std::optional<WaitingMotion> surest;
    int tried = 0;
    for (const int reference : pool_.turns()) {
      if (tried == kMaxAttempts) break;
      if (pool_.age(reference) < options_.orb.min_frames && !pool_.mayStartEarly(reference)) {
        continue;
      }
      Attempt next = attemptFrom(pool_.view(reference), {camera_, options_, clock_});
      if (next.made) return next;
      pool_.remember(reference, next.summary);
      tried += next.summary.tried ? 1 : 0;
      keepSurest(next.motion, surest);
      if (reference == 0) first = std::move(next);
    }
    first.motion = surest;
    return first;
  }

  /// Whether the corners left the image only because the camera rotated.
  [[nodiscard]] bool onlyRotated() const {
    const CornerTracks tracks = pool_.newestTracks();
    return tracks.size() >= kMinRotationTracks &&
           rotationResidualDeg(tracks.matchesTo(tracks.frames() - 1), camera_) <
               kMinRotationResidualDeg;
  }

  /// Makes the frame the only reference. @return the step
  InitStep startOver(FramePtr frame, InitStep step) {
    clock_.time("corners", [&] { pool_.start(std::move(frame)); });
    return step;
  }

  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  ReferencePool pool_;
  StageClock clock_;
  ResetLog resets_;
  bool spent_ = false;
  bool hurried_ = false;
  int blank_ = 0;    // frames in a row that show nothing
  int put_off_ = 0;  // attempts in a row, for want of time
};

}  // namespace

std::unique_ptr<Initializer> makeOrbInitializer(const InitializerOptions& options,
                                                const PinholeCamera& camera) {
  return std::make_unique<ORBInitializer>(options, camera);
}

}  // namespace dsorb::init_orb
