// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/odometry.h"

#include "geometry/reattachment.h"
#include "support/truth_initializer.h"
#include "synthetic/sequence.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

constexpr int kInitialFrames = 4;  // of the initialization by truth

/// A rendered sequence, each frame made once.
class World {
 public:
  explicit World(synthetic::SequenceKind kind, int length)
      : sequence_(sequenceOptions(kind, length)) {
    for (int i = 0; i < length; ++i) frames_.push_back(sequence_.framePtr(i));
  }
  [[nodiscard]] const PinholeCamera& camera() const { return sequence_.camera(); }
  [[nodiscard]] const std::vector<FramePtr>& frames() const { return frames_; }
  [[nodiscard]] SE3 pose(int index) const { return sequence_.pose(index); }
  /// Row-major [1/m].
  [[nodiscard]] std::vector<float> inverseDepth(int index) const {
    return sequence_.inverseDepth(index);
  }

  /// @param cell side of the squares with one point each [px]
  [[nodiscard]] std::unique_ptr<Initializer> initializer(int frames = kInitialFrames,
                                                         int cell = 8) const {
    return std::make_unique<TruthInitializer>(
        camera(),
        Truth{[this](int id) { return pose(id); }, [this](int id) { return inverseDepth(id); }},
        frames,
        cell);
  }
  /// The true initialization by the first frames.
  [[nodiscard]] InitializationResult initialization(int frames = kInitialFrames,
                                                    int cell = 8) const {
    const std::unique_ptr<Initializer> truth = initializer(frames, cell);
    InitStep step;
    for (int i = 0; i < frames; ++i) step = truth->addFrame(frames_[static_cast<std::size_t>(i)]);
    return step.result.value();
  }
  /// Length of an initialization's unit [m].
  [[nodiscard]] double unitOf(const InitializationResult& start) const {
    const PosedFrame& newest = start.frames.back();
    return (pose(newest.frame->id().value).inverse() * pose(referenceOf(start)))
               .translation()
               .norm() /
           newest.T_cam_ref->translation().norm();
  }
  /// True pose of a frame in the origin and the unit of an initialization.
  [[nodiscard]] SE3 T_cam_world(const InitializationResult& start, int index) const {
    SE3 T = pose(index).inverse() * pose(referenceOf(start));
    T.setTranslation(T.translation() / unitOf(start));
    return T;
  }
  [[nodiscard]] static int referenceOf(const InitializationResult& start) {
    return start.frames.front().frame->id().value;
  }
  [[nodiscard]] Odometry odometry(const OdometryOptions& options = {}) const {
    return Odometry(camera(), options, initializer());
  }

 private:
  static synthetic::SequenceOptions sequenceOptions(synthetic::SequenceKind kind, int length) {
    synthetic::SequenceOptions options;
    options.kind = kind;
    options.width = 320;
    options.height = 240;
    options.length = length;
    options.noise_sigma = 1;
    return options;
  }

  synthetic::SyntheticSequence sequence_;
  std::vector<FramePtr> frames_;
};

/// A room of 30 frames, rendered once.
inline const World& trackedRoom() {
  static const World world(synthetic::SequenceKind::kRoom, 30);
  return world;
}
// Poses of its tracked frames: measured at most 0.039 deg and 0.00055 units; margin x2.
constexpr double kTrackedRotationDeg = 0.08;
constexpr double kTrackedTranslation = 0.0011;

/// Writes down everything it is told.
class Recorder : public OdometryObserver {
 public:
  void onInitStep(const InitStep& step, const Frame& /*frame*/, int segment) override {
    events.push_back("init " + std::to_string(segment));
    if (!step.result) return;
    references.push_back(World::referenceOf(*step.result));
    starts[segment] = *step.result;
  }
  void onFrame(const FrameEstimate& estimate) override {
    events.push_back(std::string(name(estimate.state)) + " " + std::to_string(estimate.segment));
    estimates.push_back(estimate);
  }
  void onKeyframe(const KeyframeSnapshot& keyframe) override {
    events.push_back("keyframe " + std::to_string(keyframe.id.value));
    keyframes.push_back(keyframe);
    ids.insert(keyframe.id.value);
  }
  void onKeyframeRetired(const KeyframeSnapshot& keyframe) override {
    events.push_back("retired " + std::to_string(keyframe.id.value));
  }
  void onStartRefused(const StartRefusal& refusal) override {
    events.push_back("refused " + std::to_string(refusal.segment));
    refusals.push_back(refusal);
  }
  void onLost(FrameId frame, int segment) override {
    events.push_back("lost at " + std::to_string(frame.value) + " in " + std::to_string(segment));
  }

  std::vector<std::string> events;
  std::vector<int> references;                 ///< first frame of each initialization
  std::map<int, InitializationResult> starts;  ///< the last one of each segment
  std::vector<FrameEstimate> estimates;
  std::vector<KeyframeSnapshot> keyframes;
  std::vector<StartRefusal> refusals;
  std::set<int> ids;  ///< of the keyframes
};

/// True pose in the segment's own origin and unit.
inline SE3 truePose(const World& world, const Recorder& recorder, const FrameEstimate& estimate) {
  return world.T_cam_world(recorder.starts.at(estimate.segment), estimate.frame->id().value)
      .inverse();
}

/// Feeds frames [begin, end).
inline void feed(Odometry& odometry, const World& world, int begin, int end) {
  for (int i = begin; i < end; ++i) odometry.process(world.frames()[static_cast<std::size_t>(i)]);
}

/// Poses of all frames by the last word on them: frames hang on their keyframes, those of the
/// initialization follow its reference and its newest frame, as in the files of a run.
class FinalTrajectory : public OdometryObserver {
 public:
  void onInitStep(const InitStep& step, const Frame& /*frame*/, int /*segment*/) override {
    frames_.clear();
    anchors_.clear();
    if (!step.result) return;
    const int reference = World::referenceOf(*step.result);
    anchors_[reference] = SE3();
    const std::vector<PosedFrame>& posed = step.result->frames;
    newest_ = posed.back().frame->id().value;
    T_newest_reference_ = *posed.back().T_cam_ref;
    for (std::size_t i = 0; i < posed.size(); ++i) {
      const double progress = static_cast<double>(i) / static_cast<double>(posed.size() - 1);
      if (!posed[i].T_cam_ref) continue;
      frames_[posed[i].frame->id().value] = {reference, *posed[i].T_cam_ref, progress};
    }
  }
  void onFrame(const FrameEstimate& estimate) override {
    if (estimate.state == OdometryState::kLost) ++losses;
    if (!estimate.T_world_cam) return;
    frames_[estimate.frame->id().value] = {estimate.keyframe->value, *estimate.T_cam_keyframe};
  }
  void onKeyframe(const KeyframeSnapshot& keyframe) override {
    anchors_[keyframe.id.value] = keyframe.T_world_cam;
  }
  void onKeyframeRetired(const KeyframeSnapshot& keyframe) override {
    anchors_[keyframe.id.value] = keyframe.T_world_cam;
    ++retired;
    points += keyframe.points.size();
  }

  [[nodiscard]] std::size_t posed() const { return frames_.size(); }
  /// Root mean square position error after the best similarity, over the length of the way.
  [[nodiscard]] double relativeError(const World& world) const {
    Eigen::Matrix3Xd estimated(3, static_cast<Eigen::Index>(frames_.size()));
    Eigen::Matrix3Xd truth(3, estimated.cols());
    Eigen::Index column = 0;
    for (const auto& [index, hung] : frames_) {
      const auto keyframe = anchors_.find(index);
      const SE3 pose = keyframe == anchors_.end() ? T_world_cam(hung) : keyframe->second;
      estimated.col(column) = pose.translation();
      truth.col(column++) = world.pose(index).translation();
    }
    const Eigen::Affine3d truth_from_estimated(Eigen::umeyama(estimated, truth));
    const Eigen::Matrix3Xd errors = truth_from_estimated * estimated - truth;
    const Eigen::Index steps = truth.cols() - 1;
    const double way = (truth.rightCols(steps) - truth.leftCols(steps)).colwise().norm().sum();
    return std::sqrt(errors.colwise().squaredNorm().mean()) / way;
  }

  int losses = 0;
  int retired = 0;
  std::size_t points = 0;  ///< of retired keyframes

 private:
  struct Hung {
    int anchor = 0;
    SE3 T_cam_anchor;
    std::optional<double> progress = std::nullopt;  ///< of a frame of the initialization
  };
  [[nodiscard]] SE3 T_world_cam(const Hung& hung) const {
    const SE3& T_world_anchor = anchors_.at(hung.anchor);
    if (!hung.progress) return T_world_anchor * hung.T_cam_anchor.inverse();
    const CorrectedMotion ends{T_newest_reference_,
                               anchors_.at(newest_).inverse() * T_world_anchor};
    return T_world_anchor * reattach(hung.T_cam_anchor, ends, *hung.progress).inverse();
  }

  int newest_ = 0;  ///< frame of the initialization
  SE3 T_newest_reference_;
  std::map<int, Hung> frames_;
  std::map<int, SE3> anchors_;
};

/// An odometry started by the truth, with observers that write everything down.
class TruthStarted : public ::testing::Test {
 protected:
  void start(const World& world, const OdometryOptions& options = {}) {
    world_ = &world;
    odometry.emplace(world.camera(), options, world.initializer());
    odometry->addObserver(&recorder);
    odometry->addObserver(&trajectory);
  }
  /// Feeds frames [begin, end).
  void run(int begin, int end) { feed(*odometry, *world_, begin, end); }
  [[nodiscard]] const FrameEstimate& last() const { return recorder.estimates.back(); }

  Recorder recorder;
  FinalTrajectory trajectory;
  std::optional<Odometry> odometry;

 private:
  const World* world_ = nullptr;
};

}  // namespace dsorb
