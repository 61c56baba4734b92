// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/options/skip.h"

#include "dsorb/error.h"

#include <algorithm>
#include <sstream>

namespace dsorb {

const std::vector<MechanismName>& mechanisms() {
  static const std::vector<MechanismName> kAll = {
      {Mechanism::kPool, "pool", "further references while the first one waits"},
      {Mechanism::kFar, "far", "descriptors where optical flow loses most corners"},
      {Mechanism::kBlank, "blank", "frames that show nothing are passed over"},
      {Mechanism::kStuck, "stuck", "tracks that move with the camera are left out"},
      {Mechanism::kDynamic,
       "dynamic",
       "what contradicts the motion together goes; a rival motion waits"},
      {Mechanism::kRotation, "rotation", "a rotation that explains the matches better refuses"},
      {Mechanism::kNoise, "noise", "noise of the tracks is measured (without it the option's)"},
      {Mechanism::kRowMotions, "row_motions", "motion of each frame of a rolling shutter"},
      {Mechanism::kRefinement, "refinement", "corners are refined by their images"},
      {Mechanism::kHopeless, "hopeless", "the refinement of a hopeless start ends early"},
      {Mechanism::kRetry, "retry", "attempts that would miss the gate again are left out"},
      {Mechanism::kYoung, "young", "a start with moving rows has to be surer before 8 frames"},
      {Mechanism::kMisfit, "misfit", "errors beyond the images' noise widen covariances"},
      {Mechanism::kTail, "tail", "heavy tails of the errors widen clustered covariances"},
      {Mechanism::kClusters, "clusters", "errors of neighbours count as one in covariances"},
      {Mechanism::kPlane, "plane", "the other motion of a plane"},
      {Mechanism::kReadoutProfile, "readout_profile", "the start estimates an unknown readout"},
      {Mechanism::kJudge, "judge", "the window refuses starts that its adjustment contradicts"},
      {Mechanism::kFillUp, "fill_up", "a sparse start is filled up by epipolar search"},
      {Mechanism::kUncertain, "uncertain", "poses that the window hardly knows are refused"},
      {Mechanism::kDoubtful, "doubtful", "grown residuals off the motion are refused"},
      {Mechanism::kUnfit, "unfit", "frames that fit badly teach the map nothing"},
      {Mechanism::kGrey, "grey", "distributions of grey levels give and support the gain"},
      {Mechanism::kCameraScore, "camera_score", "the window asks whether the camera is right"},
      {Mechanism::kMissed, "missed", "some frames may stay without a pose before a loss"},
      {Mechanism::kMatches, "matches", "matched corners pose frames that the tracker loses"},
      {Mechanism::kProof, "proof", "after a miss the images must show a pose"},
      {Mechanism::kExpected, "expected", "far epipolar searches begin at the depths around"},
      {Mechanism::kContrast, "contrast", "images of little contrast get the usual one"},
      {Mechanism::kEdges, "edges", "tracks on edges go where most are on edges"}};
  return kAll;
}

Skips parseSkips(const std::string& names) {
  Skips skips;
  std::istringstream words(names);
  for (std::string word; std::getline(words, word, ',');) {
    const auto found = std::find_if(mechanisms().begin(),
                                    mechanisms().end(),
                                    [&](const MechanismName& entry) { return word == entry.name; });
    if (found == mechanisms().end()) {
      std::ostringstream known;
      for (const MechanismName& entry : mechanisms()) known << ' ' << entry.name;
      throw ConfigError("skip: '" + word + "' is no mechanism; known are" + known.str());
    }
    skips.add(found->mechanism);
  }
  return skips;
}

}  // namespace dsorb
