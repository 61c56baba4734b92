// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "base/median.h"
#include "support/matchers.h"
#include "synthetic/sequence.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

/// A synthetic sequence with all frames made; rendering is the slow part of the tests.
class RenderedSequence {
 public:
  explicit RenderedSequence(const synthetic::SequenceOptions& options) : sequence_(options) {
    for (int i = 0; i < sequence_.length(); ++i) frames_.push_back(sequence_.framePtr(i));
  }
  [[nodiscard]] const PinholeCamera& camera() const { return sequence_.camera(); }
  [[nodiscard]] int length() const { return sequence_.length(); }
  [[nodiscard]] const std::vector<FramePtr>& frames() const { return frames_; }
  [[nodiscard]] SE3 pose(int index) const { return sequence_.pose(index); }
  [[nodiscard]] std::vector<float> inverseDepth(int index) const {
    return sequence_.inverseDepth(index);
  }
  /// The image of one frame under another id, with the timestamp that belongs to it.
  [[nodiscard]] FramePtr copyAs(int index, int id) const {
    const Frame& frame = *frames_[static_cast<std::size_t>(index)];
    std::vector<float> pixels;
    for (int y = 0; y < frame.height(); ++y) {
      for (int x = 0; x < frame.width(); ++x) pixels.push_back(frame.level(0).at(x, y).intensity);
    }
    return Frame::create({pixels.data(), frame.width(), frame.height()},
                         {FrameId{id}, 0.1 * id, frame.exposure(), nullptr});
  }

 private:
  synthetic::SyntheticSequence sequence_;
  std::vector<FramePtr> frames_;
};

/// Sequences of the tests, each rendered once.
inline const RenderedSequence& rendered(const synthetic::SequenceOptions& options) {
  static std::map<std::string, RenderedSequence> sequences;
  std::ostringstream key;
  key << static_cast<int>(options.kind) << " " << options.length << " " << options.noise_sigma
      << " " << options.exposure_changes << " " << options.seed << " " << options.fx << " "
      << options.width << " " << options.height << " " << options.moving_object << " "
      << options.moving_object_share << " " << options.moving_object_plain << " "
      << options.camera_speed << " " << options.speed << " " << options.rate << " "
      << options.readout << " " << options.motion_blur << " " << options.light << " "
      << options.vignette << " " << options.nonlinear_response << " "
      << options.rendering.supersampling;
  return sequences.try_emplace(key.str(), options).first->second;
}

/// What an initializer answered, frame by frame.
struct InitRun {
  std::vector<InitStep> steps;
  std::optional<InitializationResult> result;

  /// One word a frame, for failure messages.
  [[nodiscard]] std::string log() const {
    std::string text = "answers:";
    for (const InitStep& step : steps) {
      text += std::string(" ") + name(step.reason);
      if (step.status == InitStatus::kRestarted) text += "!";
    }
    return text;
  }
};

/// Feeds frames until the first result.
inline InitRun feed(Initializer& initializer, const std::vector<FramePtr>& frames) {
  InitRun run;
  for (const FramePtr& frame : frames) {
    run.steps.push_back(initializer.addFrame(frame));
    if (run.steps.back().result) {
      run.result = run.steps.back().result;
      break;
    }
  }
  return run;
}

struct StartErrors {
  double rotation_deg = 0;           ///< worst of all posed frames
  double direction_deg = 0;          ///< of the newest frame's translation
  double median_relative_depth = 0;  ///< of inverse depth, after the best single scale
  double median_squared_error_over_variance = 0;
};

/// No bound holds for the median of nothing.
inline double medianOrNan(std::vector<double> values) {
  return values.empty() ? NAN : medianOf(std::move(values));
}

/// Compares a result with the truth; frame ids are indices of the sequence. Points hosted in the
/// reference count, where the truth has a finite depth.
inline StartErrors startErrors(const InitializationResult& result,
                               const RenderedSequence& sequence) {
  StartErrors errors;
  const int reference = result.frames.front().frame->id().value;
  const auto truth = [&](const PosedFrame& frame) {
    return sequence.pose(frame.frame->id().value).inverse() * sequence.pose(reference);
  };
  for (const PosedFrame& frame : result.frames) {
    if (!frame.T_cam_ref) continue;
    errors.rotation_deg =
        std::max(errors.rotation_deg, rotationErrorDeg(*frame.T_cam_ref, truth(frame)));
  }
  const PosedFrame& newest = result.frames.back();
  errors.direction_deg =
      directionErrorDeg(newest.T_cam_ref->translation(), truth(newest).translation());

  const std::vector<float> inverse_depth = sequence.inverseDepth(reference);
  struct Pair {
    double estimate, truth, variance;
  };
  std::vector<Pair> pairs;
  std::vector<double> ratios;
  for (const InitPoint& point : result.points) {
    const auto x = static_cast<int>(std::lround(point.pixel.x()));
    const auto y = static_cast<int>(std::lround(point.pixel.y()));
    const double true_value =
        inverse_depth[static_cast<std::size_t>(y * sequence.camera().width + x)];
    if (point.host != 0 || !(true_value > 0)) continue;
    pairs.push_back({point.inverse_depth, true_value, point.variance});
    ratios.push_back(point.inverse_depth / true_value);
  }
  const double scale = medianOrNan(ratios);
  std::vector<double> relative;
  std::vector<double> normalized;
  for (const Pair& pair : pairs) {
    const double error = pair.estimate - scale * pair.truth;
    relative.push_back(std::abs(error) / (scale * pair.truth));
    normalized.push_back(error * error / pair.variance);
  }
  errors.median_relative_depth = medianOrNan(relative);
  errors.median_squared_error_over_variance = medianOrNan(normalized);
  return errors;
}

/// What the stages found, as numbers.
inline std::vector<double> scoresOf(const InitReport& report) {
  std::vector<double> scores = {report.median_relative_sigma, report.wrong_probability.value_or(0)};
  for (const Detail& detail : report.details) scores.push_back(detail.value);
  return scores;
}

/// Whether two results agree in every bit of poses, points and scores; times aside.
inline bool sameBits(const InitializationResult& a, const InitializationResult& b) {
  if (a.frames.size() != b.frames.size() || a.points.size() != b.points.size()) return false;
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    const PosedFrame& fa = a.frames[i];
    const PosedFrame& fb = b.frames[i];
    if (fa.frame != fb.frame || fa.T_cam_ref.has_value() != fb.T_cam_ref.has_value() ||
        fa.affine.a != fb.affine.a || fa.affine.b != fb.affine.b ||
        fa.covariance != fb.covariance) {
      return false;
    }
    if (fa.T_cam_ref && fa.T_cam_ref->matrix() != fb.T_cam_ref->matrix()) return false;
  }
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    const InitPoint& pa = a.points[i];
    const InitPoint& pb = b.points[i];
    if (pa.pixel != pb.pixel || pa.inverse_depth != pb.inverse_depth ||
        pa.variance != pb.variance || pa.observations != pb.observations) {
      return false;
    }
  }
  return scoresOf(a.report) == scoresOf(b.report);
}

}  // namespace dsorb
