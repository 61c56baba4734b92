// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/self_calibration/camera_finder.h"

#include "base/angles.h"
#include "base/median.h"
#include "base/parallel.h"
#include "camera/lens_models.h"
#include "estimate/variance_factors.h"
#include "image/image_scale.h"
#include "self_calibration/camera_adjustment.h"
#include "self_calibration/corner_paths.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iomanip>
#include <limits>
#include <map>
#include <sstream>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

using self_calibration::adjust;
using self_calibration::CornerPaths;
using self_calibration::FocalChange;
using self_calibration::LensPrior;
using self_calibration::LensVector;
using self_calibration::Scene;
using self_calibration::Sight;
using self_calibration::Sighting;
using self_calibration::ViewShifts;
using variance_factors::kFoundCamera;

constexpr std::size_t kMaxViews = 40;    // an even number; of more, every second one goes
constexpr std::size_t kFewestViews = 6;  // that are adjusted
constexpr std::size_t kFewestCorners = 60;
constexpr std::size_t kMostCorners = 800;  // those seen in most views
constexpr std::size_t kFewestSights = 3;   // of a corner
constexpr double kViewStep = 16;      // between two views, for an image diagonal of 800 px [px]
constexpr double kLeastViewStep = 4;  // where the others are too few
constexpr double kViewShare = 0.8;  // of the corners of a view; where fewer are left comes the next

constexpr int kFirstIterations = 6;  // before wrong corners are left out
constexpr int kIterations = 30;
constexpr double kFirstNoise = 0.5;   // of a corner, for an image diagonal of 800 px [px]
constexpr double kLeastNoise = 0.05;  // [px]
constexpr double kWrong = 8;          // times the noise: a corner that is none

constexpr double kShows = 3;         // standard deviations from what a number was held at
constexpr double kReadoutShows = 1;  // a readout above is nearer to the truth than none

// Beforehand: what phones, webcams and action cameras have.
constexpr double kCenterSigma = 0.02;  // share of the longer side
constexpr double kK1Sigma = 0.3;
constexpr double kK2Sigma = 0.15;
constexpr double kK3Sigma = 0.05;     // once another one shows
constexpr double kSquare = 5e-4;      // what pixels that are told as square are off by at most
constexpr double kAspectSigma = 0.3;  // once pixels are not square, as in images that were squeezed

/// How far the corners that two images share have moved: the median [px]; infinite where they
/// share too few.
double stepBetween(const std::vector<Sighting>& from, const std::vector<Sighting>& to) {
  std::vector<double> steps;
  auto other = from.begin();
  for (const Sighting& sighting : to) {
    while (other != from.end() && other->corner < sighting.corner) ++other;
    if (other == from.end()) break;
    if (other->corner != sighting.corner) continue;
    steps.push_back(static_cast<double>((sighting.pixel - other->pixel).norm()));
  }
  if (static_cast<double>(steps.size()) < kViewShare * static_cast<double>(from.size())) {
    return std::numeric_limits<double>::infinity();
  }
  return medianInPlace(steps);
}

/// Makes velocities the mean of those before and after an image.
void centreVelocities(const std::vector<Sighting>& next, std::vector<Sighting>& seen) {
  auto later = next.begin();
  for (Sighting& sighting : seen) {
    while (later != next.end() && later->corner < sighting.corner) ++later;
    if (later == next.end()) return;
    if (later->corner != sighting.corner) continue;
    const bool began = sighting.velocity.isZero(0);
    sighting.velocity =
        began ? later->velocity : Eigen::Vector2f(0.5F * (sighting.velocity + later->velocity));
  }
}

LensVector numbersOf(const Lens& lens) {
  LensVector numbers;
  const bool bent = lens.model == LensModel::kRadTan;
  numbers << std::log(lens.fx), lens.cx, lens.cy, bent ? lens.coefficients[0] : 0,
      bent ? lens.coefficients[1] : 0, bent ? lens.coefficients[4] : 0, lens.readout.seconds, 0,
      std::log(lens.fy / lens.fx);
  return numbers;
}

double centerSigma(const Lens& guess) {
  return kCenterSigma * std::max(guess.width, guess.height);
}

LensPrior priorOf(const Lens& guess) {
  LensPrior prior{numbersOf(guess), LensVector::Zero()};
  if (guess.focal_sigma > 0) {
    const double center = centerSigma(guess);
    prior.sigma << guess.focal_sigma, center, center, kK1Sigma, kK2Sigma, 0, 0, 0, 0;
  }
  prior.sigma[self_calibration::kReadout] = guess.readout.sigma;
  prior.sigma /= kFoundCamera;  // must count as the corners do
  return prior;
}

double noiseOf(const Scene& scene) {
  return std::max(kLeastNoise, medianOf(sightErrors(scene)) / kMedianLength);
}

/// The part that some views see, with the corners that three of them see.
Scene partOf(const Scene& scene, std::size_t first_view, std::size_t last_view) {
  Scene part;
  part.lens = scene.lens;
  part.views.assign(scene.views.begin() + static_cast<std::ptrdiff_t>(first_view),
                    scene.views.begin() + static_cast<std::ptrdiff_t>(last_view));
  for (auto sight = scene.sights.begin(); sight != scene.sights.end();) {
    const std::size_t corner = sight->corner;
    const std::size_t before = part.sights.size();
    for (; sight != scene.sights.end() && sight->corner == corner; ++sight) {
      if (sight->view < first_view || sight->view >= last_view) continue;
      part.sights.push_back(*sight);
      part.sights.back().view -= first_view;
      part.sights.back().corner = part.corners.size();
    }
    if (part.sights.size() - before < kFewestSights) {
      part.sights.resize(before);
    } else {
      part.corners.push_back(scene.corners[corner]);
    }
  }
  return part;
}

/// Half of what the focal lengths by the two halves of the views differ, relative: what independent
/// errors of corners do not tell. 0 where a half sees too little.
double disagreement(const Scene& scene, const LensPrior& prior, double noise) {
  const std::size_t middle = scene.views.size() / 2;
  Scene early = partOf(scene, 0, middle);
  Scene late = partOf(scene, middle, scene.views.size());
  if (std::min(early.corners.size(), late.corners.size()) < kFewestCorners) return 0;
  adjust(prior, noise, kIterations, early);
  adjust(prior, noise, kIterations, late);
  return 0.5 *
         std::abs(early.lens[self_calibration::kLogFocal] - late.lens[self_calibration::kLogFocal]);
}

}  // namespace

class CameraFinder::Impl {
 public:
  Impl(const Lens& guess, const Lens& images, const PinholeCamera& rectified, int threads)
      : guess_(guess),
        images_(images),
        rectified_(rectified),
        step_(kLeastViewStep * imageScale(rectified.width, rectified.height)),
        arena_(threads) {}

  void take(const FrameEstimate& estimate) {
    if (estimate.segment != segment_ || !estimate.T_world_cam) {
      // Without a pose nothing is known of how the next one lies to those before.
      if (estimate.segment != segment_ || estimate.state == OdometryState::kLost) paths_.clear();
      segment_ = estimate.segment;
      if (!estimate.T_world_cam) return;
    }
    ++frames_;
    View view{estimate.T_world_cam->inverse(),
              arena_.run([&] { return paths_.add(*estimate.frame); })};
    if (newest_is_view_) centreVelocities(view.seen, views_.back().seen);
    newest_is_view_ = views_.empty() || stepBetween(views_.back().seen, view.seen) > step_;
    if (!newest_is_view_) return;
    views_.push_back(std::move(view));
    if (views_.size() <= kMaxViews) return;
    for (std::size_t i = 1; 2 * i < views_.size(); ++i) views_[i] = std::move(views_[2 * i]);
    views_.resize((views_.size() + 1) / 2);
    step_ *= 2;
  }

  [[nodiscard]] int frames() const { return frames_; }

  [[nodiscard]] std::optional<FoundCamera> find() const {
    const std::vector<View> views = farApart();
    if (views.size() < kFewestViews) return std::nullopt;
    LensPrior prior = priorOf(guess_);
    double noise = kFirstNoise * imageScale(images_.width, images_.height);
    Scene scene = sceneOf(views);
    // What is held stays as the guess says.
    scene.lens = (prior.sigma.array() > 0).select(scene.lens, prior.mean);
    placeCorners(scene);
    if (scene.corners.size() < kFewestCorners) return std::nullopt;
    adjust(prior, noise, kFirstIterations, scene);
    if (prior.sigma[self_calibration::kLogFocal] > 0) {
      freeWhereItShows(self_calibration::kAspect, kAspectSigma, noiseOf(scene), prior, scene);
    }
    for (int round = 0; round < 2; ++round) {
      noise = noiseOf(scene);
      leaveOutAbove(kWrong * noise, scene);
      if (scene.corners.size() < kFewestCorners) return std::nullopt;
      adjust(prior, noise, kIterations, scene);
    }
    noise = noiseOf(scene);
    holdWhatDoesNotShow(noise, prior, scene);
    FoundCamera found = told(scene, kFoundCamera * lensSigmas(prior, noise, scene));
    double& sigma = found.lens.focal_sigma;
    if (!(sigma > 0)) return found;
    const FocalChange change = focalChange(prior, noise, kIterations, scene);
    found.focal_change = change.relative;
    found.focal_change_sigma = kFoundCamera * change.sigma;
    sigma = std::hypot(sigma, disagreement(scene, prior, noise));
    if (found.changes()) sigma = std::hypot(sigma, change.relative);
    const ViewShifts shifts =
        viewShifts(prior, noise, centerSigma(guess_) / kFoundCamera, kIterations, scene);
    found.shift = shifts.rms;
    found.shift_gain = shifts.gain / (kFoundCamera * kFoundCamera);
    if (found.isStabilized()) sigma = std::hypot(sigma, shifts.focal);
    return found;
  }

 private:
  /// What is kept of an image with a pose.
  struct View {
    SE3 T_cam_world;
    std::vector<Sighting> seen;
  };
  /// Where the image as it was taken shows what the rectified one shows at a pixel.
  [[nodiscard]] Eigen::Vector2d taken(const Eigen::Vector2f& pixel) const {
    return projectThroughLens(images_, rectified_.unproject(pixel.cast<double>()).head<2>());
  }

  [[nodiscard]] Sight sightOf(const Sighting& seen, std::size_t view, std::size_t corner) const {
    constexpr float kInstant = 1e-3F;  // [s]
    Sight sight{view, corner, taken(seen.pixel)};
    const Eigen::Vector2d velocity = (taken(seen.pixel + kInstant * seen.velocity) - sight.pixel) /
                                     static_cast<double>(kInstant);
    const double line = images_.columns ? sight.pixel.x() / (images_.width - 1)
                                        : sight.pixel.y() / (images_.height - 1);
    sight.drift = (images_.backwards ? 0.5 - line : line - 0.5) * velocity;
    return sight;
  }

  /// The views that are a whole step apart; all where these are too few.
  [[nodiscard]] std::vector<View> farApart() const {
    const double step = kViewStep * imageScale(rectified_.width, rectified_.height);
    std::vector<View> views;
    for (const View& view : views_) {
      if (views.empty() || stepBetween(views.back().seen, view.seen) > step) views.push_back(view);
    }
    return views.size() < kFewestViews ? views_ : views;
  }

  /// Views with the corners that are seen in most of them, not yet placed.
  [[nodiscard]] Scene sceneOf(const std::vector<View>& views) const {
    std::map<int, std::vector<Sight>> by_corner;
    for (std::size_t v = 0; v < views.size(); ++v) {
      for (const Sighting& seen : views[v].seen) {
        by_corner[seen.corner].push_back(sightOf(seen, v, 0));
      }
    }
    std::vector<std::vector<Sight>> corners;
    for (auto& entry : by_corner) {
      if (entry.second.size() >= kFewestSights) corners.push_back(std::move(entry.second));
    }
    std::stable_sort(corners.begin(), corners.end(), [](const auto& a, const auto& b) {
      return a.size() > b.size();
    });
    corners.resize(std::min(corners.size(), kMostCorners));
    Scene scene;
    scene.lens = numbersOf(images_);
    for (const View& view : views) scene.views.push_back(view.T_cam_world);
    for (std::size_t i = 0; i < corners.size(); ++i) {
      for (Sight& sight : corners[i]) {
        sight.corner = i;
        scene.sights.push_back(sight);
      }
    }
    scene.corners.resize(corners.size());
    return scene;
  }

  /// A distortion and a readout that are not told from none are none.
  static void holdWhatDoesNotShow(double noise, LensPrior& prior, Scene& scene) {
    const LensVector sigmas = kFoundCamera * lensSigmas(prior, noise, scene);
    const auto shows = [&](int i, double limit) {
      return std::abs(scene.lens[i]) > limit * sigmas[i];
    };
    const auto hold = [&](int i) {
      if (!(prior.sigma[i] > 0)) return false;
      prior.sigma[i] = scene.lens[i] = 0;
      return true;
    };
    bool changed = false;
    if (!shows(self_calibration::kReadout, kReadoutShows))
      changed = hold(self_calibration::kReadout);
    if (!shows(self_calibration::kRadial, kShows) &&
        !shows(self_calibration::kRadial + 1, kShows)) {
      changed = hold(self_calibration::kRadial) || changed;
      changed = hold(self_calibration::kRadial + 1) || changed;
    }
    if (changed) adjust(prior, noise, kIterations, scene);
    if (prior.sigma[self_calibration::kRadial] > 0) {
      freeWhereItShows(self_calibration::kRadial + 2, kK3Sigma, noise, prior, scene);
    }
  }

  /// Frees a number of the lens where it then differs from what it was held at.
  static void freeWhereItShows(
      int number, double sigma, double noise, LensPrior& prior, Scene& scene) {
    LensPrior further = prior;
    further.sigma[number] = sigma / kFoundCamera;
    Scene freed = scene;
    adjust(further, noise, kIterations, freed);
    const double deviation = kFoundCamera * lensSigmas(further, noise, freed)[number];
    if (!(std::abs(freed.lens[number] - further.mean[number]) > kShows * deviation)) return;
    prior = further;
    scene = std::move(freed);
  }

  [[nodiscard]] FoundCamera told(const Scene& scene, const LensVector& sigmas) const {
    FoundCamera found;
    Lens& lens = found.lens = guess_;
    lens.fx = std::exp(scene.lens[self_calibration::kLogFocal]);
    lens.fy = std::exp(scene.lens[self_calibration::kAspect]) * lens.fx;
    lens.cx = scene.lens[self_calibration::kCenter];
    lens.cy = scene.lens[self_calibration::kCenter + 1];
    const double k1 = scene.lens[self_calibration::kRadial];
    const double k2 = scene.lens[self_calibration::kRadial + 1];
    lens.model = k1 == 0 && k2 == 0 ? LensModel::kPinhole : LensModel::kRadTan;
    lens.coefficients = {k1, k2, 0, 0, scene.lens[self_calibration::kRadial + 2]};
    lens.readout = {scene.lens[self_calibration::kReadout], sigmas[self_calibration::kReadout]};
    lens.focal_sigma = sigmas[self_calibration::kLogFocal];
    found.center_sigma =
        std::max(sigmas[self_calibration::kCenter], sigmas[self_calibration::kCenter + 1]);
    found.k1_sigma = sigmas[self_calibration::kRadial];
    found.views = static_cast<int>(scene.views.size());
    found.corners = static_cast<int>(scene.corners.size());
    found.error = medianOf(sightErrors(scene));
    return found;
  }

  Lens guess_;   // what is known beforehand
  Lens images_;  // that images are rectified with
  PinholeCamera rectified_;
  double step_;  // least between two views [px]
  TaskArena arena_;
  CornerPaths paths_;
  std::vector<View> views_;
  bool newest_is_view_ = false;
  int segment_ = -1;
  int frames_ = 0;
};

std::string describe(const FoundCamera& camera) {
  const Lens& lens = camera.lens;
  const double sigma = lens.focal_sigma * lens.fx;
  std::ostringstream text;
  text << std::fixed << std::setprecision(sigma < 1 ? 1 : 0) << "focal length " << lens.fx << " +- "
       << sigma << " px (" << std::setprecision(1)
       << 2 * std::atan(0.5 * lens.width / lens.fx) * kDegPerRad << " degrees)";
  if (std::abs(lens.fy - lens.fx) > kSquare * lens.fx) {
    text << std::setprecision(3) << ", pixels " << lens.fx / lens.fy << " times as high as wide";
  }
  if (lens.model != LensModel::kPinhole) {
    text << std::setprecision(2) << ", distortion " << lens.coefficients[0] << " +- "
         << std::setprecision(camera.k1_sigma < 0.01 ? 3 : 2) << camera.k1_sigma;
  }
  if (lens.readout.seconds != 0) {
    text << std::setprecision(1) << ", readout " << 1000 * lens.readout.seconds << " +- "
         << 1000 * lens.readout.sigma << " ms";
  }
  if (camera.isStabilized()) {
    text << std::setprecision(0) << "; images move by " << camera.shift
         << " px in their frame as those of stabilized video do: turns and paths are wrong";
  } else if (camera.changes()) {
    text << std::setprecision(0) << "; it changes by " << 100 * camera.focal_change << " +- "
         << std::ceil(100 * camera.focal_change_sigma)
         << " % from the first image to the last: zoom or focus breathing";
  } else if (!camera.isKnown()) {
    text << std::setprecision(0) << "; these images do not tell it better, turns may be "
         << std::ceil(100 * lens.focal_sigma) << " % off";
  }
  return text.str();
}

CameraFinder::CameraFinder(const Lens& guess,
                           const Lens& images,
                           const PinholeCamera& rectified,
                           int threads)
    : impl_(std::make_unique<Impl>(guess, images, rectified, threads)) {}
CameraFinder::~CameraFinder() = default;

void CameraFinder::onFrame(const FrameEstimate& estimate) {
  impl_->take(estimate);
}

int CameraFinder::frames() const {
  return impl_->frames();
}

std::optional<FoundCamera> CameraFinder::find() const {
  return impl_->find();
}

}  // namespace dsorb
