// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"
#include "init/orb/photometric/photometric_kernels.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Of a grey value, for the weight of known depths against images [grey levels^2].
constexpr double kGreyVariance = 8;
constexpr std::size_t kPatchGrain = 128;  ///< patches one thread takes at a time

/// A frame of the photometric adjustment.
struct PhotometricFrame {
  std::size_t index = 0;  ///< into InitialMap::frames
  const PyramidLevel* image = nullptr;
  double exposure = 1;  ///< [s]
  std::optional<RollingShutter> shutter{};
};

/// What stays constant during one photometric adjustment: patches of the reference at one pyramid
/// level, the frames they are compared with, and which patch counts in which frame.
struct PhotometricProblem {
  int level = 0;
  PinholeCamera camera;  ///< of the level
  PhotometricBrightness brightness = PhotometricBrightness::kAffine;
  double reference_exposure = 1;  ///< [s]
  std::vector<PhotometricFrame> frames;
  std::vector<HostPatch> patches;
  std::vector<std::size_t> source;  ///< by patch: corner, or number of corners + semi-dense point
  std::vector<char> seen;           ///< [frame * patches + patch]: takes part
  std::vector<KnownInverseDepth> known{};  ///< by patch; empty: nothing is known
  std::optional<RollingShutter> reference_shutter{};

  [[nodiscard]] const char* seenIn(std::size_t frame) const {
    return seen.data() + frame * patches.size();
  }
};

/// The unknowns, in the order of the problem.
struct PhotometricState {
  std::vector<SE3> T_cam_ref;
  std::vector<AffineBrightness> affine;
  std::vector<double> inverse_depth;
};

/// At most `count` posed frames after the reference, evenly spaced, the last posed one included;
/// all if it is 0.
std::vector<std::size_t> spreadFrames(const InitialMap& map, int count);

/// Corners and semi-dense points whose pattern lies inside the reference. All are marked as seen.
/// Runs in parallel inside the caller's arena.
PhotometricProblem makeProblem(const InitialMap& map,
                               const PinholeCamera& camera,
                               const PhotometricOptions& options,
                               const std::vector<std::size_t>& frames,
                               int level);

/// Makes the problem at level 0 with the frames that the options select.
PhotometricProblem makeProblem(const InitialMap& map,
                               const PinholeCamera& camera,
                               const PhotometricOptions& options);

/// Rows of the problem's frames in the map's joint covariance, 6 a frame; empty where one has none.
std::vector<Eigen::Index> jointRows(const InitialMap& map, const PhotometricProblem& problem);

PhotometricState makeState(const PhotometricProblem& problem, const InitialMap& map);

/// Moves the patches of a rolling shutter to where a global one would have seen them.
void placePatches(PhotometricProblem& problem, const PhotometricState& state);

/// Sets what has a unit, in the map's present one: motions of the rows, what the caller knows of
/// the patches.
void takeUnit(PhotometricProblem& problem, const InitialMap& map);

/// What a patch's known inverse depth adds to its sums, which are in squared grey levels; nothing
/// where none is known.
KnownTerm knownTerm(const PhotometricProblem& problem, std::size_t patch, double inverse_depth);

/// Sets `problem.seen`: the whole pattern is inside the frame. @return share of all pairs [-]
double findVisible(PhotometricProblem& problem, const PhotometricState& state);

/// Puts the unknowns back into the map they came from.
void writeState(const PhotometricProblem& problem, const PhotometricState& state, InitialMap& map);

/// Problem of some of the patches with all frames. @param patches indices in rising order
PhotometricProblem subProblem(const PhotometricProblem& problem,
                              const std::vector<std::size_t>& patches);

/// One frame for the kernels.
PatchImage patchImage(const PhotometricProblem& problem,
                      const PhotometricState& state,
                      std::size_t frame);

/// Residuals of all patches in one frame.
struct FrameResiduals {
  std::vector<float> values;  ///< kPatternSize a patch [grey levels]; undefined where not valid
  std::vector<char> valid;    ///< by patch: takes part

  [[nodiscard]] const float* of(std::size_t patch) const {
    return values.data() + patch * kPatternSize;
  }
};

/// Residuals of all patches in every frame. Runs in parallel inside the caller's arena.
std::vector<FrameResiduals> residualsOf(const PhotometricProblem& problem,
                                        const PhotometricState& state);

}  // namespace dsorb::init_orb
