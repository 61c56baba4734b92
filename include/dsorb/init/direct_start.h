// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"
#include "dsorb/init/start_judge.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

namespace dsorb {

/// What a direct system takes of a start.
struct DirectStartOptions {
  int keyframes = 4;        ///< that the start gives, if it has as many posed frames: 2 or more
  double border = 4;        ///< of points: a pattern of radius 2 and its interpolation [px]
  double max_sigma = 0.1;   ///< relative; points that are less sure are left out [-]
  double max_prior = 2500;  ///< of StartDepth::prior [grey levels^2 unit^2]
  bool fixed_brightness = false;  ///< all frames get a = b = 0
  int max_refusals = 2;           ///< in a row; the next start stays: DirectStart::judge
};

/// Depth of a point that a start hands over.
struct StartDepth {
  double inverse_depth = 0;  ///< in the host [1/unit]
  double sigma = 0;          ///< standard deviation of the inverse depth [1/unit]
  /// Information for a Hessian of squared grey levels: errors of a start are not independent, so it
  /// is limited. A system whose prior does not pull needs none of it but a flag.
  double prior = 0;
};

/// Depth of a point after the first adjustment.
struct AdjustedDepth {
  double inverse_depth = 0;  ///< not above 0: the point was dropped
  double information = 0;    ///< of the images alone, without a prior [grey levels^2 unit^2]
};

/// Puts starts into a direct system with keyframes, points hosted in them and a window of its own.
/// It waits, keeps images, chooses keyframes and points and judges what the first adjustment made
/// of them. `Fork` says what only the system knows, over the system's types:
///
///     struct Fork {
///       using Frame = Record*;  // what the system keeps of each image: it comes back as given
///       using Point = int;      // of a point; it may outlive the point
///       void posed(Frame, const dsorb::PosedFrame&);  // of each posed frame, in order
///       Keyframe* makeFrame(Frame, const dsorb::PosedFrame&, const float* pixels);
///       void addKeyframe(Keyframe*);  // to the window; its points follow
///       Point addPoint(Keyframe* host, int u, int v, const dsorb::StartDepth&);
///       dsorb::SE3 pose(Keyframe*);  // T_cam_world, in any world and unit
///       dsorb::AdjustedDepth depth(Point);
///       void trace(Keyframe*);  // may be missing; of a frame that becomes no keyframe
///     };
///
/// The pixels of makeFrame are those given, and are there until it returns.
template <typename Fork>
class DirectStart {
 public:
  using Frame = typename Fork::Frame;  ///< of each image
  using Point = typename Fork::Point;  ///< of the window
  /// What Fork::makeFrame returns.
  using Keyframe = decltype(std::declval<Fork&>().makeFrame(
      std::declval<Frame>(), std::declval<const PosedFrame&>(), nullptr));

  /// @param refusals number of starts refused in a row; it outlives a system that is deleted to be
  ///        reset, and this object with it
  /// @throws as makeInitializer
  DirectStart(const InitializerOptions& initializer,
              const PinholeCamera& camera,
              const DirectStartOptions& options,
              int& refusals)
      : options_(options),
        camera_(camera),
        refusals_(refusals),
        initializer_(makeInitializer(initializer, camera)) {}

  /// Takes the next image; where it starts the map, the keyframes but the newest, and all points,
  /// are in the window afterwards. After a start it waits for another one.
  /// @param image runs of exact zeros that begin at its edges show nothing: an undistorter's border
  /// @param info  without an id, the images are counted and their times not looked at
  /// @return with a start its newest keyframe, to be treated as any tracked one: added to the
  ///         window, which then is adjusted and given to judge()
  /// @throws as Initializer::addFrame
  std::optional<Keyframe> addFrame(Fork& fork,
                                   Frame frame,
                                   const ImageView& image,
                                   FrameInfo info = {}) {
    if (info.id.value < 0) {
      info.id = FrameId{images_};
      info.timestamp = images_++;
    }
    const std::vector<float> pixels = withoutBorder(image);
    const FramePtr kept =
        dsorb::Frame::create(ImageView(pixels.data(), image.width(), image.height()), info);
    InitStep step = initializer_->addFrame(kept);
    const auto forgotten = [](const Given& given) { return given.first.expired(); };
    given_.erase(std::remove_if(given_.begin(), given_.end(), forgotten), given_.end());
    given_.emplace_back(kept, frame);
    if (!step.result) return std::nullopt;
    initializer_->reset();
    return handOver(fork, *step.result);
  }

  /// Judges a start by the first adjustment; other adjustments are not looked at.
  /// @param rms of a pixel's residual [grey levels]
  /// @return why the start is to be thrown away, and the system with it; nothing: it stays
  std::optional<RefusalReason> judge(Fork& fork, double rms) {
    if (keyframes_.empty()) return std::nullopt;
    std::optional<RefusalReason> reason = verdict(fork, rms);
    keyframes_.clear();
    points_.clear();
    const bool broken = reason == RefusalReason::kAdjustment;
    if (reason && !broken && refusals_ >= options_.max_refusals) reason.reset();
    refusals_ = reason ? refusals_ + 1 : 0;
    return reason;
  }

  /// Initializer::setHurried.
  void setHurried(bool hurried) { initializer_->setHurried(hurried); }

 private:
  using Given = std::pair<std::weak_ptr<const dsorb::Frame>, Frame>;
  struct StartedPoint {
    Point point;
    StartDepth start;
    bool stays;  // the newest keyframe sees it; a window drops what leaves the image
  };

  template <typename F, typename = void>
  struct Traces : std::false_type {};
  template <typename F>
  struct Traces<F, std::void_t<decltype(std::declval<F&>().trace(std::declval<Keyframe>()))>>
      : std::true_type {};

  /// Pixels as floats, with NaN for the zeros that reach an edge of the image in their row or
  /// column.
  static std::vector<float> withoutBorder(const ImageView& image) {
    const int w = image.width(), h = image.height();
    std::vector<float> pixels;
    if (image.empty()) return pixels;  // which Frame refuses
    const auto append = [&](const auto* row) { pixels.insert(pixels.end(), row, row + w); };
    const bool bytes = image.type() == ImageView::Type::kUint8;
    for (int y = 0; y < h; ++y) {
      bytes ? append(image.row<std::uint8_t>(y)) : append(image.row<float>(y));
    }
    const auto mark = [&](int first, int step, int count) {
      for (float* p = pixels.data() + first; count > 0 && !(*p > 0 || *p < 0); --count, p += step)
        *p = NAN;
    };
    for (int y = 0; y < h; ++y) mark(y * w, 1, w), mark(y * w + w - 1, -1, w);
    for (int x = 0; x < w; ++x) mark(x, w, h), mark(x + (h - 1) * w, -w, h);
    return pixels;
  }

  /// The reference, the newest and frames spread between them, of the posed ones.
  std::vector<std::size_t> chosen(const std::vector<PosedFrame>& frames) const {
    std::vector<std::size_t> posed, keyframes;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      if (frames[i].T_cam_ref) posed.push_back(i);
    }
    const auto steps = static_cast<std::size_t>(std::max(options_.keyframes, 2) - 1);
    for (std::size_t k = 0; k <= steps; ++k) {
      keyframes.push_back(posed[(k * (posed.size() - 1) + steps / 2) / steps]);
    }
    return keyframes;
  }

  Keyframe makeFrame(Fork& fork, Frame frame, const PosedFrame& posed) const {
    const PyramidLevel& image = posed.frame->level(0);
    std::vector<float> pixels(image.data(), image.row(image.height()));
    for (float& pixel : pixels) pixel = std::isnan(pixel) ? 0 : pixel;
    return fork.makeFrame(frame, posed, pixels.data());
  }

  std::optional<Keyframe> handOver(Fork& fork, InitializationResult& start) {
    keyframes_.clear();
    points_.clear();
    const std::vector<std::size_t> keyframes = chosen(start.frames);
    for (std::size_t i = 0; i < start.frames.size(); ++i) {
      PosedFrame& posed = start.frames[i];
      if (!posed.T_cam_ref) continue;
      if (options_.fixed_brightness) posed.affine = {};
      const auto given = std::find_if(given_.begin(), given_.end(), [&](const Given& g) {
        return g.first.lock() == posed.frame;
      });
      fork.posed(given->second, posed);
      if (std::find(keyframes.begin(), keyframes.end(), i) != keyframes.end()) {
        keyframes_.emplace_back(makeFrame(fork, given->second, posed), *posed.T_cam_ref);
        if (i + 1 == start.frames.size()) break;
        fork.addKeyframe(keyframes_.back().first);
        addPoints(fork, start, i);
      } else if constexpr (Traces<Fork>::value) {
        fork.trace(makeFrame(fork, given->second, posed));
      }
    }
    given_.clear();
    return keyframes_.back().first;
  }

  /// Points of one host. Those of frames that become no keyframe are left out: `orb` and `coarse`
  /// host all in the reference.
  void addPoints(Fork& fork, const InitializationResult& start, std::size_t host) {
    const SE3 T_newest_host =
        *start.frames.back().T_cam_ref * start.frames[host].T_cam_ref->inverse();
    for (const InitPoint& p : start.points) {
      const double sigma = std::sqrt(p.variance);
      const Eigen::Vector2d pixel = p.pixel.cast<double>().array().round();
      const bool sure = sigma <= options_.max_sigma * p.inverse_depth;
      if (static_cast<std::size_t>(p.host) != host || !sure) continue;
      if (!camera_.contains(pixel, options_.border)) continue;
      const StartDepth depth{
          p.inverse_depth, sigma, std::min(kGreyVariance / p.variance, options_.max_prior)};
      const Eigen::Vector3d seen = T_newest_host * (camera_.unproject(pixel) / p.inverse_depth);
      const bool stays = seen.z() > 0 && camera_.contains(camera_.project(seen), options_.border);
      const int u = static_cast<int>(pixel.x()), v = static_cast<int>(pixel.y());
      points_.push_back({fork.addPoint(keyframes_.back().first, u, v, depth), depth, stays});
    }
  }

  std::optional<RefusalReason> verdict(Fork& fork, double rms) const {
    if (!std::isfinite(rms)) return RefusalReason::kAdjustment;
    const SE3 T_ref_world = fork.pose(keyframes_.front().first).inverse();
    std::vector<StartPose> poses;
    for (std::size_t k = 1; k < keyframes_.size(); ++k) {
      poses.push_back({keyframes_[k].second, fork.pose(keyframes_[k].first) * T_ref_world});
    }
    const double noise = std::min(rms, kMaxStartNoise);
    std::vector<StartPoint> points;
    bool any = false;
    for (const StartedPoint& started : points_) {
      const AdjustedDepth now = fork.depth(started.point);
      const bool kept = now.inverse_depth > 0 && now.information > 0;
      if (!kept && !started.stays) continue;
      const double sigma = started.start.sigma;
      points.push_back({started.start.inverse_depth, sigma * sigma, 0, 0});
      if (!kept) continue;
      points.back().adjusted = now.inverse_depth;
      points.back().adjusted_variance = noise * noise / now.information;
      any = true;
    }
    if (!any) return RefusalReason::kAdjustment;
    return refusalOf(startChange(poses, points));
  }

  static constexpr double kGreyVariance = 8;  // of a pixel [grey levels^2]

  DirectStartOptions options_;
  PinholeCamera camera_;
  int& refusals_;
  std::unique_ptr<Initializer> initializer_;
  int images_ = 0;
  std::vector<Given> given_;                         // images that the initializer still has
  std::vector<std::pair<Keyframe, SE3>> keyframes_;  // as handed over, until they are judged
  std::vector<StartedPoint> points_;
};

}  // namespace dsorb
